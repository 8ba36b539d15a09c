"""The magnetic anomaly, measured by a magnetometer."""

from functools import lru_cache

from isogal.fields.measured import MeasuredField
from isogal.scenario import Route, Settings
from isogal.sensors.magnetometer import MagneticReduction, MainField
from isogal.sensors.trajectory import drive


def _reduction(scenario: Settings) -> MagneticReduction:
    return MagneticReduction(
        _main_field(scenario.route, scenario.navigation_rate, scenario.magnetometer.epoch)
    )


@lru_cache(maxsize=4)
def _main_field(route: Route, rate: float, epoch: float) -> MainField:
    rows, _ = drive(route, rate)
    return MainField(rows[:, 0], rows[:, 1], route.height, epoch)


MAGNETIC = MeasuredField(
    name="magnetic",
    instrument="magnetometer",
    quantity="magnetic_anomaly",
    unit="nT",
    least_sigma=1e-4,
    sign=1.0,
    reduction=_reduction,
)
