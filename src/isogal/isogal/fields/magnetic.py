"""The magnetic anomaly, measured by a magnetometer."""

from isogal.fields.measured import MeasuredField
from isogal.scenario import Scenario
from isogal.sensors.magnetometer import MagneticReduction, MainField
from isogal.sensors.trajectory import build_trajectory


def _reduction(scenario: Scenario) -> MagneticReduction:
    route = build_trajectory(scenario)
    height, epoch = scenario.route.height, scenario.magnetometer.epoch
    return MagneticReduction(MainField(route.latitude, route.longitude, height, epoch))


MAGNETIC = MeasuredField(
    name="magnetic",
    instrument="magnetometer",
    quantity="magnetic_anomaly",
    unit="nT",
    least_sigma=1e-4,
    sign=1.0,
    reduction=_reduction,
)
