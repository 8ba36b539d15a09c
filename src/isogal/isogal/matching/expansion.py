"""Readings that are more than one number: from what the scans of a batch gave to its rows.

Rows of a batch are scans times channels or beams. A row names its channel, whose map predicts it
(`isogal.maps.channels`), or its beam, which has a place of its own; what the rows of a scan have
in common are parameters. Everything else a matcher does with a batch stays as it is for one
number. Which expansion a scenario needs says `expansion_of`."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.fields.magnetic_vehicle import prior_sigma
from isogal.fields.measured import measured_field
from isogal.maps.channels import ChannelMap, channels_of
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch, Layout
from isogal.matching.parameters import Parameters
from isogal.matching.reading_noise import scan_noise
from isogal.matching.registry import able, require
from isogal.matrices import symmetric
from isogal.scenario import Assumed, Gradiometer
from isogal.sensors.altimeter import PARTS
from isogal.sensors.gradiometer import EOTVOS, tilt_effect


class Expansion(Protocol):
    """What is done with the readings of an instrument."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows of a scan, and numbers of each: the value that the map is compared with, and what
        else belongs to it."""
        ...

    def expand(self, batch: Batch, readings: Array, offset: Array) -> Batch:
        """Return the whole batch, given that of a row for each scan, the readings (T, *shape), NaN
        = none, and what is known to be wrong with the values (T,)."""
        ...


def expansion_of(assumed: Assumed) -> Expansion | None:
    """Return what is done with readings in a scenario; None where they are numbers.

    Raises
    ------
    InputError
        The scenario's matcher does not estimate parameters, or a file cannot be read.
    """
    name, matcher = assumed.measured_field, assumed.matcher.name
    if (covariance := measured_field(assumed).covariance(assumed)) is not None:
        if name != "gradient":
            return Channels(covariance)
        return Channels(covariance, with_allowed_tilt(assumed.gradiometer, matcher))
    if name == "magnetic" and assumed.magnetometer.online:
        require(matcher, "takes_parameters", "magnetometer.online")
        return OwnField(prior_sigma(assumed.magnetometer))
    altimeter = assumed.altimeter
    if name == "terrain" and altimeter.sounds:
        require(matcher, "takes_parameters", "altimeter.beams, scale_sigma")
        return Soundings(altimeter.count, altimeter.scale_sigma)
    return None


def with_allowed_tilt(assumed: Gradiometer, matcher: str) -> Gradiometer:
    """Return what a matcher assumes of a gradiometer; raises InputError where it does not estimate
    what is assumed of tilt and offsets."""
    if assumed.wanders:
        require(matcher, "takes_parameters", "gradiometer.bias_eotvos ...")
    several = len(assumed.components) > 1
    if several and not assumed.platform_tilt and able(matcher, "takes_parameters"):
        # no tilt is specified, but what is not allowed for passes for an error of position
        return assumed.model_copy(update={"platform_tilt": assumed.allowed_tilt})
    return assumed


@dataclass(frozen=True, slots=True, eq=False)
class Channels:
    """Several numbers at each scan, such as components of the gravity gradient tensor
    (docs/mathematics.md, section 12.4)."""

    covariance: Array
    """(C, C) of the sensor's noise."""
    gradiometer: Gradiometer | None = None
    """Whose components they are; None = of another instrument."""

    @property
    def shape(self) -> tuple[int, int]:
        """One number of each channel."""
        return len(self.covariance), 1

    def expand(self, batch: Batch, readings: Array, offset: Array) -> Batch:
        """Return the batch with a row for each channel, with how the map errors of channels go
        together, and with tilt and offsets as parameters."""
        whole = channel_batch(batch, readings[..., 0], self.covariance)
        assumed = self.gradiometer
        if assumed is None:
            return whole
        slow = _slow_errors(assumed, whole) if assumed.wanders else None
        assert whole.layout is not None
        layout = replace(whole.layout, of_one_potential=assumed.of_one_potential)
        return replace(whole, layout=layout, instrument=whole.instrument.along(slow))


def channel_batch(batch: Batch, readings: ArrayLike, covariance: ArrayLike) -> Batch:
    """Return a batch with several readings at each scan.

    Parameters
    ----------
    batch : Batch
        Of one channel: stamps, positions, transition and prior are taken over; its readings, sigma
        and offset are not. What the navigator's error does to readings by their reduction is not
        known for other channels, and taken as nothing.
    readings : (T, C) array
        Unit of the maps; NaN = no reading of that channel at that scan.
    covariance : (C, C) array
        Of the sensor's noise, positive definite.

    Raises
    ------
    InputError
        Shapes that do not fit, or a covariance that is not positive definite.
    """
    readings, covariance = np.asarray(readings, np.float64), np.asarray(covariance, np.float64)
    if readings.ndim != 2 or readings.shape[0] != len(batch):
        raise InputError(
            f"readings of several channels must have shape ({len(batch)}, channels),"
            f" have {readings.shape}"
        )
    scans, channels = readings.shape
    fits = covariance.shape == (channels, channels) and np.isfinite(covariance).all()
    if not (fits and np.linalg.eigvalsh(symmetric(covariance))[0] > 0.0):
        raise InputError(
            "covariance of readings of several channels must be positive definite, and have shape"
            f" ({channels}, {channels}); has {covariance.shape}"
        )
    white, common = scan_noise(symmetric(covariance), scans)
    rows = _repeated(batch, channels)
    not_of_readings = np.array([1.0, 1.0, 0.0])[:, None]
    apart = rows.apart
    return replace(
        rows,
        reading=readings.reshape(-1),
        sigma=white,
        by_error=rows.by_error * not_of_readings,
        apart=None if apart is None else apart * not_of_readings,
        layout=Layout(np.tile(np.arange(channels), scans)),
        instrument=replace(rows.instrument, parameters=common),
    )


def _repeated(batch: Batch, count: int) -> Batch:
    """Return a batch with so many rows for each scan, whose readings were not reduced with the
    scan's own place and velocity alone."""
    rows = batch.part(np.repeat(np.arange(len(batch)), count))
    return replace(rows, new=batch.new * count, instrument=replace(rows.instrument, added=None))


def _slow_errors(assumed: Gradiometer, batch: Batch) -> Parameters:
    """Return the platform's tilt and the components' offsets."""
    assert batch.channel is not None
    parts, components = list[Parameters](), assumed.components
    if assumed.platform_tilt > 0.0:
        effect = tilt_effect(components, batch.latitude)[np.arange(len(batch)), batch.channel]
        sigma, time = np.full(2, assumed.platform_tilt), np.full(2, assumed.platform_time)
        parts.append(Parameters(("tilt_north", "tilt_east"), sigma, effect, time=time))
    if assumed.bias_eotvos > 0.0 or assumed.bias_walk_eotvos > 0.0:
        names = tuple(f"bias_{name}" for name in components)
        sigma = np.full(len(names), assumed.bias_eotvos * EOTVOS)
        walk = np.full(len(names), assumed.bias_walk_eotvos * EOTVOS)
        parts.append(Parameters(names, sigma, np.eye(len(names))[batch.channel], walk=walk))
    together = Parameters.together(parts)
    assert together is not None
    return together


@dataclass(frozen=True, slots=True, eq=False)
class OwnField:
    """Total fields with the terms of what the vehicle adds, whose coefficients are estimated
    (docs/magnetometer.md, section 5.2)."""

    sigma: Array
    """(C,) 1-sigma of the coefficients before the first reading, nT."""

    @property
    def shape(self) -> tuple[int, int]:
        """The anomaly, and the terms of the same reading."""
        return 1, 1 + len(self.sigma)

    def expand(self, batch: Batch, readings: Array, offset: Array) -> Batch:
        """Return the batch with the coefficients as parameters."""
        there = np.asarray(np.isfinite(readings[:, 0]).all(axis=1))
        terms = np.where(there[:, None], readings[:, 0, 1:], 0.0)
        own = Parameters(("",) * len(self.sigma), self.sigma, terms)
        reading = np.where(there, batch.reading, np.nan)
        return replace(batch, reading=reading, instrument=batch.instrument.along(own))


@dataclass(frozen=True, slots=True)
class Soundings:
    """Terrain heights under several beams, each at its own place (docs/mathematics.md, section
    2.7)."""

    beams: int
    scale_sigma: float
    """1-sigma of the scale error of all ranges; 0 = there is none."""

    @property
    def shape(self) -> tuple[int, int]:
        """Heights, and footprints m north, east and down of the vehicle."""
        return self.beams, PARTS

    def expand(self, batch: Batch, readings: Array, offset: Array) -> Batch:
        """Return the batch with a row for each beam, at the place of its footprint."""
        met = np.asarray(np.isfinite(readings).all(axis=-1))
        foot = np.where(met[..., None], readings[..., 1:], 0.0).reshape(-1, PARTS - 1)
        height = np.where(met, readings[..., 0] - offset[:, None], np.nan)
        rows = _repeated(batch, self.beams)
        north, east = metres_per_radian(rows.latitude)
        scale = None
        if self.scale_sigma > 0.0:
            sigma = np.array([self.scale_sigma])
            scale = Parameters(("range_scale",), sigma, -foot[:, 2:], foot[:, :2, None])
        return replace(
            rows,
            latitude=rows.latitude + foot[:, 0] / north,
            longitude=rows.longitude + foot[:, 1] / east,
            reading=height.reshape(-1),
            layout=Layout(np.tile(np.arange(self.beams), len(batch)), beams=True),
            instrument=rows.instrument.along(scale),
            end_place=batch.end,
        )


def first_channel(batch: Batch, field_map: FieldMap | ChannelMap) -> tuple[Batch, FieldMap]:
    """Return the part of a batch that belongs to the first map or beam, and that map; a batch of
    one as it is.

    For what is shown of a batch: candidates on contours, the map's variability.
    """
    first = channels_of(field_map)[0]
    if batch.layout is None:
        return batch, first
    rows = np.flatnonzero(batch.layout.index == 0)
    new = int((rows >= len(batch) - batch.new).sum())
    part = replace(
        batch.part(rows),
        new=new,
        layout=None,
        instrument=replace(batch.instrument, parameters=None),
    )
    return part, first
