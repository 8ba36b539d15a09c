"""Readings that are more than one number: from what a scan gave to rows of a batch.

A `BatchBuilder` asks an `Expansion` for it; which one a scenario needs says `expansion_of`."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from isogal.arrays import Array
from isogal.fields.magnetic_vehicle import prior_sigma
from isogal.matching.interfaces import Batch
from isogal.matching.parameters import Parameters
from isogal.matching.registry import require
from isogal.scenario import Scenario


class Expansion(Protocol):
    """What is done with the readings of an instrument."""

    def split(self, reading: Any) -> tuple[Any, Array]:
        """Return of a reduced reading what the map is compared with, and what else belongs to it;
        NaN = no reading."""
        ...

    def expand(self, batch: Batch, values: Sequence[Any], details: Sequence[Array]) -> Batch:
        """Return the whole batch, given the one of a row for each scan."""
        ...


def expansion_of(scenario: Scenario) -> Expansion | None:
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
    return None


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

    def expand(self, batch: Batch, values: Sequence[Any], details: Sequence[Array]) -> Batch:
        """Return the batch with the coefficients as parameters."""
        return replace(batch, parameters=Parameters((), self._sigma, np.stack(details)))
