"""The scalar fields that can be measured and matched. To add one: a `Reduction`, an entry here, and a message adapter in isogal_ros."""

from collections.abc import Callable
from dataclasses import dataclass

from isogal.errors import InputError
from isogal.scenario import Scenario
from isogal.sensors.altimeter import TerrainReduction
from isogal.sensors.gravimeter import DisturbanceReduction, GravityReduction
from isogal.sensors.magnetometer import MagneticReduction, MainField
from isogal.sensors.reduction import Reduction
from isogal.sensors.trajectory import build_trajectory


@dataclass(frozen=True)
class ScalarField:
    """One field."""

    name: str
    """As the scenario's key `field` has it."""
    instrument: str
    """What feels it; fields of one instrument are reductions of the same readings."""
    quantity: str
    """What a map of it is a map of, see `isogal.maps.quantities`."""
    unit: str
    """Of maps, readings and sigmas, inside."""
    least_sigma: float
    """No instrument is as good; a smaller `gravimeter.sigma` is meant for another field."""
    sign: float
    """How the raw reading goes with the field: 1, or -1 where it falls as the field rises."""
    reduction: Callable[[Scenario], Reduction]
    """Returns how readings of this field are made and reduced in a scenario; raises InputError where its route cannot be driven."""


def _magnetic(scenario: Scenario) -> MagneticReduction:
    route = build_trajectory(scenario)
    height, epoch = scenario.route.height, scenario.magnetometer.epoch
    return MagneticReduction(MainField(route.latitude, route.longitude, height, epoch))


FIELDS = {
    field.name: field
    for field in (
        ScalarField("gravity", "gravimeter", "gravity", "m/s²", 0.0, 1.0, lambda scenario: GravityReduction()),
        ScalarField(
            "disturbance", "gravimeter", "disturbance", "m/s²", 0.0, 1.0, lambda scenario: DisturbanceReduction()
        ),
        ScalarField("magnetic", "magnetometer", "magnetic_anomaly", "nT", 1e-4, 1.0, _magnetic),
        ScalarField(
            "terrain", "altimeter", "height", "m", 1e-4, -1.0, lambda scenario: TerrainReduction(scenario.altimeter)
        ),
    )
}
"""By name."""


def scalar_field(scenario: Scenario) -> ScalarField:
    """Return the field that a scenario measures and matches.

    Raises
    ------
    InputError
        `gravimeter.sigma` is not in this field's unit.
    """
    field, sigma = FIELDS[scenario.scalar_field], scenario.gravimeter.sigma
    if sigma < field.least_sigma:
        raise InputError(
            f"gravimeter.sigma: must be in {field.unit} where field is {field.name}, at least {field.least_sigma:g}; is {sigma:g}"
        )
    return field


def of_instrument(instrument: str) -> list[ScalarField]:
    """Return all fields that one instrument's readings can be reduced to."""
    return [field for field in FIELDS.values() if field.instrument == instrument]
