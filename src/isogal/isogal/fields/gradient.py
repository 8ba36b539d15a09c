"""Components of the gravity gradient tensor, measured by a gradiometer; their maps are computed
from that of the disturbance."""

from isogal.arrays import Array, Integers
from isogal.fields.measured import Channels, MeasuredField
from isogal.fields.source_map import MapSource
from isogal.maps.channels import ChannelMap
from isogal.maps.field_map import FieldMap
from isogal.scenario import Settings, Truth
from isogal.sensors.gradiometer import GradientReduction
from isogal.sensors.gradiometer_errors import noise_covariance, noise_of, tilt_errors
from isogal.sensors.trajectory import Trajectory

_REACH = 20_000.0


def _maps(settings: Settings, disturbance: FieldMap) -> ChannelMap:
    from isogal.maps.potential import tensor_maps  # imports SciPy

    source = MapSource(settings.map, "disturbance")
    level, height = source.for_gradients(disturbance, settings.route.height)
    return tensor_maps(level, settings.gradiometer.components, height=height, edge=_REACH)


def _errors(
    truth: Truth, run: int, trajectory: Trajectory, index: Integers, sensed: Array
) -> Array:
    settings, time = truth.gradiometer, trajectory.time[index]
    noise = noise_of(settings, truth.gravimeter).draw(truth.seed, run, time, sensed.shape[1:])
    return noise + tilt_errors(settings, truth.seed, run, trajectory, index, sensed)


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
        errors=_errors,
        source="disturbance",
        reach=_REACH,
        maps=_maps,
    ),
)
