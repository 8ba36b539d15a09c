"""Readings that are more than one number: from what a scan gave to rows of a batch.

A `BatchBuilder` asks an `Expansion` for it; which one a scenario needs says `expansion_of`."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.fields.magnetic_vehicle import prior_sigma
from isogal.matching.interfaces import Batch
from isogal.matching.parameters import Parameters
from isogal.matching.registry import able, require
from isogal.scenario import Assumed, Gradiometer
from isogal.sensors.beams import PARTS
from isogal.sensors.gradiometer_errors import EOTVOS, tilt_effect

_NOTHING = np.zeros(0)


class Expansion(Protocol):
    """What is done with the readings of an instrument."""

    def split(self, reading: Any) -> tuple[Any, Array]:
        """Return of a reduced reading what the map is compared with, and what else belongs to it;
        NaN = no reading."""
        ...

    def expand(self, batch: Batch, values: Array, details: Sequence[Array]) -> Batch:
        """Return the whole batch, given the one of a row for each scan, and what `split` has
        returned of each: readings, less what is known to be wrong with them, and the rest."""
        ...


def expansion_of(scenario: Assumed) -> Expansion | None:
    """Return what is done with readings in a scenario; None where they are numbers, or one number
    for each channel.

    Raises
    ------
    InputError
        The scenario's matcher does not estimate parameters, or a file cannot be read.
    """
    if scenario.measured_field == "magnetic" and scenario.magnetometer.online:
        require(scenario.matcher.name, "takes_parameters", "magnetometer.online")
        return OwnField(prior_sigma(scenario))
    if scenario.measured_field == "gradient":
        return tensor_of(scenario.gradiometer, scenario.matcher.name)
    altimeter = scenario.altimeter
    if scenario.measured_field == "terrain" and altimeter.sounds:
        require(scenario.matcher.name, "takes_parameters", "altimeter.beams, scale_sigma")
        return Soundings(altimeter.count, altimeter.scale_sigma)
    return None


def tensor_of(told: Gradiometer, matcher: str) -> "Tensor | None":
    """Return what is done with the readings of a gradiometer for a matcher; raises InputError
    where that does not estimate what is told of tilt and offsets."""
    if told.wanders:
        require(matcher, "takes_parameters", "gradiometer.bias_eotvos ...")
    if not told.platform_tilt and len(told.components) > 1 and able(matcher, "takes_parameters"):
        # nobody has told of a tilt, but what is not allowed for passes for an error of position
        told = told.model_copy(update={"platform_tilt": told.allowed_tilt})
    return Tensor(told) if told.of_one_potential or told.wanders else None


class Tensor:
    """Components of the gravity gradient tensor, beside what a `channel_batch` knows of them
    (docs/mathematics.md, section 12.4).

    Parameters
    ----------
    settings : scenario.Gradiometer
    """

    def __init__(self, settings: Gradiometer) -> None:
        self._settings = settings

    def split(self, reading: Any) -> tuple[Any, Array]:
        """Return the reading (C,) as it is, and nothing else."""
        return reading, _NOTHING

    def expand(self, batch: Batch, values: Array, details: Sequence[Array]) -> Batch:
        """Return the batch with how the map errors of its channels go together, and with tilt and
        offsets as parameters."""
        told = self._settings
        return replace(
            batch,
            of_one_potential=told.of_one_potential,
            parameters=Parameters.together(
                [batch.parameters, self._parameters(batch) if told.wanders else None]
            ),
        )

    def _parameters(self, batch: Batch) -> Parameters:
        told, rows = self._settings, np.arange(len(batch))
        channel = np.zeros_like(rows) if batch.channel is None else batch.channel
        names, sigma, time, walk, columns = [], [], [], [], []
        if told.platform_tilt > 0.0:
            names += ["tilt_north", "tilt_east"]
            sigma += [told.platform_tilt] * 2
            time += [told.platform_time] * 2
            walk += [0.0] * 2
            columns.append(tilt_effect(told.components, batch.latitude)[rows, channel])
        if told.bias_eotvos > 0.0 or told.bias_walk_eotvos > 0.0:
            count = len(told.components)
            names += [f"bias_{name}" for name in told.components]
            sigma += [told.bias_eotvos * EOTVOS] * count
            time += [np.inf] * count
            walk += [told.bias_walk_eotvos * EOTVOS] * count
            columns.append(np.eye(count)[channel])
        return Parameters(
            tuple(names),
            np.array(sigma),
            np.concatenate(columns, axis=1),
            time=np.array(time),
            walk=np.array(walk),
        )


class OwnField:
    """Total fields with the terms of what the vehicle adds, whose coefficients are estimated
    (docs/magnetometer.md, section 5.2).

    Parameters
    ----------
    sigma : (C,) array
        1-sigma of the coefficients before the first reading, nT.
    """

    def __init__(self, sigma: Array) -> None:
        self._sigma = sigma

    def split(self, reading: Any) -> tuple[Any, Array]:
        """Return the anomaly, and the terms (C,) of the same reading."""
        found = np.broadcast_to(reading, len(self._sigma) + 1)
        if not np.isfinite(found).all():
            return np.nan, np.zeros(len(self._sigma))
        return float(found[0]), found[1:]

    def expand(self, batch: Batch, values: Array, details: Sequence[Array]) -> Batch:
        """Return the batch with the coefficients as parameters."""
        own = Parameters((), self._sigma, np.stack(details))
        return replace(batch, parameters=Parameters.together([batch.parameters, own]))


class Soundings:
    """Terrain heights under several beams, each at its own place (docs/mathematics.md, section
    2.7).

    Parameters
    ----------
    beams : int
        B.
    scale_sigma : float
        1-sigma of the scale error of all ranges; 0 = there is none.
    """

    def __init__(self, beams: int, scale_sigma: float) -> None:
        self._beams, self._scale_sigma = beams, scale_sigma

    def split(self, reading: Any) -> tuple[Any, Array]:
        """Return the heights (B,), and their footprints (B, 3) m north, east and down of the
        vehicle."""
        found = np.broadcast_to(reading, (self._beams, PARTS))
        met = np.isfinite(found).all(axis=-1)
        return np.where(met, found[:, 0], np.nan), np.where(met[:, None], found[:, 1:], 0.0)

    def expand(self, batch: Batch, values: Array, details: Sequence[Array]) -> Batch:
        """Return the batch with a row for each beam, at the place of its footprint."""
        count, foot = self._beams, np.concatenate(details)

        rows = batch.part(np.repeat(np.arange(len(batch)), count))
        north, east = metres_per_radian(rows.latitude)
        scale = None
        if self._scale_sigma > 0.0:
            scale = Parameters(
                ("range_scale",),
                np.array([self._scale_sigma]),
                -foot[:, 2:],
                foot[:, :2, None],
            )
        return replace(
            rows,
            latitude=rows.latitude + foot[:, 0] / north,
            longitude=rows.longitude + foot[:, 1] / east,
            reading=values.reshape(-1),
            new=batch.new * count,
            reading_rate=None,
            beam=np.tile(np.arange(count), len(batch)),
            parameters=Parameters.together([rows.parameters, scale]),
            end_place=batch.end,
        )
