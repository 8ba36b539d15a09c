"""Components of the gravity gradient tensor, measured by a gradiometer; their maps are computed
from that of the disturbance."""

from isogal.arrays import Array
from isogal.fields.measured import Channels, MeasuredField
from isogal.fields.source_map import MapSource
from isogal.maps.channels import ChannelMap
from isogal.maps.field_map import FieldMap
from isogal.scenario import Settings, Truth
from isogal.sensors.gradiometer import GradientReduction, noise_covariance, noise_of, tilt_errors
from isogal.sensors.noise import RunScans

_REACH = 20_000.0


def _maps(settings: Settings, disturbance: FieldMap) -> ChannelMap:
    from isogal.maps.potential import derivatives  # imports SciPy

    source = MapSource(settings.map, "disturbance")
    level, height = source.for_gradients(disturbance, settings.route.height)
    return derivatives(level, settings.gradiometer.components, height=height, edge=_REACH)


def _errors(truth: Truth, scans: RunScans, sensed: Array) -> Array:
    settings, size = truth.gradiometer, sensed.shape[1:]
    noise = noise_of(settings, truth.gravimeter).draw(scans.seed, scans.run, scans.time, size)
    return noise + tilt_errors(settings, scans, sensed)


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
