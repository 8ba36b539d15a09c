"""What a field is that can be measured and matched, and fields by name.

A field is known by an entry point of the group `isogal.fields` that names a `MeasuredField`. It
needs a `isogal.sensors.reduction.Reduction`, and for the nodes a message adapter."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from isogal import plugins
from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.channels import ChannelMap
from isogal.maps.field_map import FieldMap
from isogal.scenario import Assumed, Gravimeter, Settings, Truth
from isogal.sensors.noise import RunScans
from isogal.sensors.reduction import AsRead, Reduction

OF_ONE_NUMBER = (*Gravimeter.errors, "filter_time", "delay")
"""Keys of the section `gravimeter` that hold for instruments whose readings are one number."""


@dataclass(frozen=True)
class Channels:
    """What a field needs in addition if its readings are C numbers, one for each channel."""

    covariance: Callable[[Settings], Array]
    """Returns the covariance (C, C) of a reading's noise, unit of the maps squared."""
    errors: Callable[[Truth, RunScans, Array], Array]
    """Returns what the instrument adds (scans, C) to a run's readings, given the truth, the scans,
    and what a perfect one senses (scans, C)."""
    source: str
    """Quantity of the map that the channels' maps are computed from."""
    reach: float
    """m of that map around a place that go into its values."""
    maps: Callable[[Settings, FieldMap], ChannelMap]
    """Computes the channels' maps; raises InputError."""


@dataclass(frozen=True)
class MeasuredField:
    """One field: a scalar, unless `channels` says how many channels it has."""

    name: str
    """As the scenario's key `field` has it."""
    instrument: str
    """What measures it; fields of one instrument are reductions of the same readings."""
    quantity: str
    """Of its map, see `isogal.maps.quantities`."""
    unit: str
    """Of maps, readings and sigmas, inside."""
    least_sigma: float
    """Smallest 1-sigma of an instrument; a smaller `gravimeter.sigma` must be in the unit of
    another field."""
    sign: float
    """1 if the raw reading rises with the field, -1 if it falls."""
    reduction: Callable[[Settings], Reduction]
    """Returns how readings of this field are made and reduced in a scenario; raises InputError
    where its route cannot be driven."""
    channels: Channels | None = None
    largest_sigma: float = math.inf
    """Largest 1-sigma of instrument or map that is likely; a larger one is another unit's."""

    @property
    def source(self) -> str:
        """Quantity of the scenario's map."""
        return self.quantity if self.channels is None else self.channels.source

    def covariance(self, settings: Settings) -> Array | None:
        """Return the covariance (C, C) of a reading's noise; None where a reading is one number,
        of `gravimeter.sigma`."""
        return None if self.channels is None else self.channels.covariance(settings)


def field_named(name: str) -> MeasuredField:
    """Return a field; raises InputError where there is none of this name."""
    return plugins.load(plugins.FIELDS, name, MeasuredField)


def fields() -> dict[str, MeasuredField]:
    """Return every field that an installed package provides, by name, Isogal's own first."""
    return {name: field_named(name) for name in plugins.names(plugins.FIELDS)}


def measured_field(settings: Settings) -> MeasuredField:
    """Return the field that a scenario measures and matches; where its readings are recorded ones
    that are values of the map, with a reduction that leaves them as they are.

    Raises
    ------
    InputError
        `gravimeter.sigma` is not in this field's unit, or keys `OF_ONE_NUMBER` are given where
        they do not count; or the scenario has several fields.
    """
    if settings.fields is not None:
        raise InputError("fields: one field is needed here, not a list of fields")
    field, sigma = field_named(settings.measured_field), settings.gravimeter.sigma
    for key in OF_ONE_NUMBER:
        if field.channels is not None and getattr(settings.gravimeter, key) != getattr(
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
    if settings.readings.reduced:
        return replace(field, sign=1.0, reduction=lambda _: AsRead())
    return field


def unlikely_sigmas(assumed: Assumed) -> list[str]:
    """Return a line for each assumed 1-sigma that seems to be in another unit than its
    field's; several fields are looked at one by one."""
    found = []
    for one in assumed.each_field:
        field = field_named(one.measured_field)
        sigmas = {
            "gravimeter.sigma": one.gravimeter.sigma,
            "gravimeter.correlated_sigma": one.gravimeter.correlated_sigma,
            "gravimeter.bias": one.gravimeter.bias,
            "map_error.sigma": one.map_error.sigma,
            "matcher.map_sigma": one.matcher.map_sigma,
        }
        for key, sigma in sigmas.items():
            if sigma != "auto" and sigma > field.largest_sigma:
                unit = "mGal" if field.unit == "m/s²" else "another unit"
                found.append(f"{key}: {sigma:g} {field.unit} is very much; is it {unit}?")
    return found


def reading_sigma(settings: Settings) -> float:
    """Return the 1-sigma of a reading's white noise, unit of the map; of its first channel where
    there are several."""
    covariance = field_named(settings.measured_field).covariance(settings)
    return settings.gravimeter.sigma if covariance is None else float(np.sqrt(covariance[0, 0]))


def of_instrument(instrument: str) -> list[MeasuredField]:
    """Return all fields that one instrument's readings can be reduced to."""
    return [field for field in fields().values() if field.instrument == instrument]
