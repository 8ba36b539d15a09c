"""A fix: a matcher makes it and a filter applies it; neither knows the other."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from isogal.arrays import Array, Integers
from isogal.inertial.error_state import batch_covariance

LOST_SIGMA = (15e3, 0.5, 1e-4, 1e-3)
"""1-sigma that a lost navigator's north and east position (m), velocity (m/s), tilt and heading
(rad) get on top of its own covariance. A wrong latitude turns the navigation frame wrongly: 10 km
let tilt grow by 7e-8 rad/s, and velocity with it; 1e-3 rad of heading do the same."""
LOST_COVARIANCE = batch_covariance(*LOST_SIGMA)
"""(7, 7) its square, as added to the covariance of a batch's states
(`isogal.inertial.error_state`)."""


class Status(Enum):
    """What has become of a batch."""

    FIX = "fix"
    DECLINED = "declined"
    """The matcher gives no fix, and says why."""
    FAILED = "failed"
    """It has raised an exception, or its fix is not finite (`isogal.matching.failures`)."""
    REJECTED = "rejected"
    """The matcher gives one, which the navigator does not believe (`isogal.fusion.model`)."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Map positions compatible with the readings, for display and for the record."""

    latitude: Array
    """(N,) rad."""
    longitude: Array
    """(N,) rad."""
    weight: Array
    """(N,) association probability within its scan."""
    scan: Integers
    """(N,) index of the scan in the batch."""


@dataclass(frozen=True, slots=True, eq=False)
class Information:
    """The measurements' likelihood of the navigator's error x in information form: log p = vector'
    x - x' matrix x / 2.

    x is the error at the batch end relative to the estimate that the batch was built with: xi (n =
    4), or xi and attitude about north, east, down in rad (n = 7).
    """

    vector: Array
    """(n,)."""
    matrix: Array
    """(n, n); negative in directions in which the posterior is wider than the navigator's own
    prior (`information`)."""


@dataclass(frozen=True, slots=True, eq=False)
class Fix:
    """What a batch says about the position at its last scan, from the measurements alone, or why
    it says nothing.
    """

    time: float
    """s, stamp of the last scan."""
    latitude: float
    """rad; the best estimate where there is one, else the navigator's."""
    longitude: float
    """rad."""
    covariance: Array
    """(2, 2) m², north-east, of the measurements alone; NaN where there is no fix."""
    reason: str | None = None
    """One line saying why the batch gives no fix; None = it gives one."""
    shown: Callable[[], Candidates] | None = None
    """Returns `candidates`, which are computed for those who look at them; None = there are
    none."""
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    """Named figures: feature_variability, consistency p-value, evidence, iterations, ..."""
    information: "Information | None" = None
    """All that the batch says about position and velocity together; None = about the position
    only, by `covariance`."""
    reset: bool = False
    """Whether the matcher found the navigator lost: its covariance must grow by LOST_SIGMA², fix
    or no fix."""
    widened: Array | None = None
    """(7, 7) what the navigator's covariance must grow by beside that; None = nothing."""
    map_error: tuple[float, float] | None = None
    """1-sigma (m/s²) and correlation length (m) of the gravity map's error, as readings have shown
    them; None = they have not, or the map is not one of gravity. A matcher that says it has the
    attribute `learns_map_error`, so that the navigator is careful until then."""
    scan_position: Array | None = None
    """(T, 2) rad, latitude and longitude of each scan, for retrodiction; None = only the last
    scan."""
    scan_covariance: Array | None = None
    """(T, 2, 2) m², north-east, such that the T fixes together hold the information of
    `covariance` once."""
    scan_information: "tuple[Information | None, ...] | None" = None
    """T shares of `information`, each about the error at its own scan and relative to the estimate
    there of a navigator that has taken the shares of earlier scans; None = positions say all."""

    failed: bool = False
    """Whether there is none because the matcher has failed."""

    @property
    def status(self) -> Status:
        """What has become of the batch."""
        if self.reason is None:
            return Status.FIX
        return Status.FAILED if self.failed else Status.DECLINED

    @property
    def candidates(self) -> Candidates | None:
        """Where the map has the readings' values; None where that is not known."""
        return None if self.shown is None else self.shown()

    @property
    def published(self) -> bool:
        """Whether the navigator may use it."""
        return self.status is Status.FIX

    @property
    def widening(self) -> Array | None:
        """(7, 7) what the navigator's covariance must grow by before the fix is used; None =
        nothing."""
        if not self.reset:
            return self.widened
        return LOST_COVARIANCE if self.widened is None else LOST_COVARIANCE + self.widened

    def of_scan(self, index: int) -> "Fix | None":
        """Return the share of one of the batch's T scans, for retrodiction; None where it has
        none.
        """
        positions, covariances = self.scan_position, self.scan_covariance
        if positions is None or covariances is None or index < 0:
            return None
        if not np.isfinite(covariances[index]).all():
            return None
        return Fix(
            time=math.nan,  # of the scan
            latitude=float(positions[index, 0]),
            longitude=float(positions[index, 1]),
            covariance=covariances[index],
            information=None if self.scan_information is None else self.scan_information[index],
            map_error=self.map_error if index == len(positions) - 1 else None,
        )
