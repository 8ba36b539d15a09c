"""Components of the gravity gradient tensor, measured by a gradiometer; their maps are computed
from that of the disturbance."""

from isogal.fields.flown_height import disturbance_for_gradients
from isogal.fields.measured import Channels, MeasuredField
from isogal.maps.channels import ChannelMap
from isogal.maps.field_map import FieldMap
from isogal.scenario import Scenario
from isogal.sensors.gradiometer import GradientReduction, draw_noise, noise_covariance
from isogal.sensors.gradiometer_errors import slow_errors

_REACH = 20_000.0


def _maps(scenario: Scenario, disturbance: FieldMap) -> ChannelMap:
    from isogal.maps.potential import tensor_maps  # imports SciPy

    level, height = disturbance_for_gradients(scenario, disturbance)
    return tensor_maps(level, scenario.gradiometer.components, height=height, edge=_REACH)


GRADIENT = MeasuredField(
    name="gradient",
    instrument="gradiometer",
    quantity="gradient",
    unit="1/s²",
    least_sigma=0.0,
    sign=1.0,
    reduction=lambda scenario: GradientReduction(scenario.gradiometer.components),
    channels=Channels(
        covariance=lambda scenario: noise_covariance(scenario.gradiometer),
        noise=draw_noise,
        source="disturbance",
        reach=_REACH,
        maps=_maps,
        slow=lambda scenario, run, *where: slow_errors(
            scenario.gradiometer, scenario.seed, run, *where
        ),
    ),
)
