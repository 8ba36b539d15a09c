"""The fields that can be measured and matched, found by name (`isogal.plugins`). To add one: a
`Reduction`, a `MeasuredField` with its entry point, and a message adapter for the nodes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from isogal import plugins
from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.channels import ChannelMap
from isogal.maps.field_map import FieldMap
from isogal.scenario import Gravimeter, Scenario
from isogal.sensors.altimeter import TerrainReduction
from isogal.sensors.gradiometer import GradientReduction, draw_noise, noise_covariance
from isogal.sensors.gravimeter import DisturbanceReduction, GravityReduction
from isogal.sensors.magnetometer import MagneticReduction, MainField
from isogal.sensors.reduction import Reduction
from isogal.sensors.trajectory import build_trajectory


@dataclass(frozen=True)
class Channels:
    """What is to know besides of a field whose readings are C numbers, one for each channel."""

    covariance: Callable[[Scenario], Array]
    """Returns the covariance (C, C) of a reading's noise, unit of the maps squared."""
    noise: Callable[[Scenario, int, int], Array]
    """Returns the noise (scans, C) of a run, given scenario, run and number of scans."""
    source: str
    """What the map is a map of that the channels' maps are computed from."""
    reach: float
    """m of that map around a place that go into its values."""
    maps: Callable[[Scenario, FieldMap], ChannelMap]
    """Computes the channels' maps; raises InputError where that cannot be."""


@dataclass(frozen=True)
class MeasuredField:
    """One field: a scalar, unless `channels` says how many channels it has."""

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
    """Returns how readings of this field are made and reduced in a scenario; raises InputError
    where its route cannot be driven."""
    channels: Channels | None = None

    @property
    def source(self) -> str:
        """What the scenario's map is a map of."""
        return self.quantity if self.channels is None else self.channels.source

    def covariance(self, scenario: Scenario) -> Array | None:
        """Return the covariance (C, C) of a reading's noise; None where a reading is one number,
        of `gravimeter.sigma`."""
        return None if self.channels is None else self.channels.covariance(scenario)


def _magnetic(scenario: Scenario) -> MagneticReduction:
    route = build_trajectory(scenario)
    height, epoch = scenario.route.height, scenario.magnetometer.epoch
    return MagneticReduction(MainField(route.latitude, route.longitude, height, epoch))


def _tensor_maps(scenario: Scenario, disturbance: FieldMap) -> ChannelMap:
    from isogal.maps.gradients import tensor_maps  # SciPy's transforms, for those who need them

    if scenario.route.height < 0.0:
        raise InputError(
            f"route.height: must be >= 0 m where field is gradient, is {scenario.route.height:g}:"
            " a map cannot be continued down towards the masses"
        )
    return tensor_maps(
        disturbance,
        scenario.gradiometer.components,
        height=scenario.route.height,
        edge=_GRADIENT_REACH,
    )


_GRADIENT_REACH = 20_000.0
_GRADIENT = Channels(
    lambda scenario: noise_covariance(scenario.gradiometer),
    draw_noise,
    "disturbance",
    _GRADIENT_REACH,
    _tensor_maps,
)

GRAVITY = MeasuredField(
    name="gravity",
    instrument="gravimeter",
    quantity="gravity",
    unit="m/s²",
    least_sigma=0.0,
    sign=1.0,
    reduction=lambda scenario: GravityReduction(),
)
DISTURBANCE = MeasuredField(
    name="disturbance",
    instrument="gravimeter",
    quantity="disturbance",
    unit="m/s²",
    least_sigma=0.0,
    sign=1.0,
    reduction=lambda scenario: DisturbanceReduction(),
)
MAGNETIC = MeasuredField(
    name="magnetic",
    instrument="magnetometer",
    quantity="magnetic_anomaly",
    unit="nT",
    least_sigma=1e-4,
    sign=1.0,
    reduction=_magnetic,
)
TERRAIN = MeasuredField(
    name="terrain",
    instrument="altimeter",
    quantity="height",
    unit="m",
    least_sigma=1e-4,
    sign=-1.0,
    reduction=lambda scenario: TerrainReduction(scenario.altimeter),
)
GRADIENT = MeasuredField(
    name="gradient",
    instrument="gradiometer",
    quantity="gradient",
    unit="1/s²",
    least_sigma=0.0,
    sign=1.0,
    reduction=lambda scenario: GradientReduction(scenario.gradiometer.components),
    channels=_GRADIENT,
)


def fields() -> dict[str, MeasuredField]:
    """Return every field that an installed package provides, by name, Isogal's own first."""
    return {name: _field(name) for name in plugins.names(plugins.FIELDS)}


def _field(name: str) -> MeasuredField:
    field: MeasuredField = plugins.load(plugins.FIELDS, name)
    return field


def measured_field(scenario: Scenario) -> MeasuredField:
    """Return the field that a scenario measures and matches.

    Raises
    ------
    InputError
        `gravimeter.sigma` is not in this field's unit, or sigma, bias or drift are given where
        they do not count.
    """
    field, sigma = _field(scenario.measured_field), scenario.gravimeter.sigma
    for key in ("sigma", "bias", "drift"):
        if field.channels is not None and getattr(scenario.gravimeter, key) != getattr(
            Gravimeter(), key
        ):
            raise InputError(
                f"gravimeter.{key}: says nothing where field is {field.name}, whose noise is in"
                f" the section {field.instrument}"
            )
    if sigma < field.least_sigma:
        raise InputError(
            f"gravimeter.sigma: must be in {field.unit} where field is {field.name}, at least"
            f" {field.least_sigma:g}; is {sigma:g}"
        )
    return field


def reading_sigma(scenario: Scenario) -> float:
    """Return the 1-sigma of a reading's white noise, unit of the map; of its first channel where
    there are several."""
    covariance = _field(scenario.measured_field).covariance(scenario)
    return scenario.gravimeter.sigma if covariance is None else float(np.sqrt(covariance[0, 0]))


def of_instrument(instrument: str) -> list[MeasuredField]:
    """Return all fields that one instrument's readings can be reduced to."""
    return [field for field in fields().values() if field.instrument == instrument]
