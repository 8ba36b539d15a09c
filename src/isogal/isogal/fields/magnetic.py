"""The magnetic anomaly, measured by a magnetometer."""

from functools import lru_cache

from isogal.fields.measured import MeasuredField
from isogal.scenario import Settings
from isogal.sensors.magnetometer import MagneticReduction, MainField
from isogal.sensors.trajectory import Trajectory, build_trajectory


def _reduction(settings: Settings) -> MagneticReduction:
    along = build_trajectory(settings)
    epoch = settings.magnetometer.epoch
    return MagneticReduction(_main_field(along, settings.route.height, epoch))


@lru_cache(maxsize=4)
def _main_field(along: Trajectory, height: float, epoch: float) -> MainField:
    return MainField(along.latitude, along.longitude, height, epoch)


MAGNETIC = MeasuredField(
    name="magnetic",
    instrument="magnetometer",
    quantity="magnetic_anomaly",
    unit="nT",
    least_sigma=1e-4,
    sign=1.0,
    reduction=_reduction,
)
