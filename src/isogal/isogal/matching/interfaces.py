"""What a matcher is given and what it gives back.

A batch is T scans of one sensor with the navigator's own estimate of where each was taken. The
unknown is the navigator's horizontal error at the last scan, xi = (d_north m, d_east m, dv_north
m/s, dv_east m/s), estimate minus truth. Over a batch the navigator's increments are good to about
a metre (docs/mathematics.md, section 4.1), so the position error at scan t is
``transition[t] @ xi`` plus what its tilt adds (``nuisance_position``). A matcher answers with a
fix of the measurements alone, without the navigator's prior."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from isogal.arrays import Array, Integers
from isogal.inertial.error_state import batch_covariance
from isogal.matching.parameters import Parameters
from isogal.matching.path import FilterPath

LOST_SIGMA = (15e3, 0.5, 1e-4, 1e-3)
"""1-sigma that a lost navigator's north and east position (m), velocity (m/s), tilt and heading
(rad) get on top of its own covariance. A wrong latitude turns the navigation frame wrongly: 10 km
let tilt grow by 7e-8 rad/s, and velocity with it; 1e-3 rad of heading do the same."""
LOST_COVARIANCE = batch_covariance(*LOST_SIGMA)
"""(7, 7) its square, as added to the covariance of a batch's states
(`isogal.inertial.error_state`)."""


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """T scans and the navigator's prior about its own error, for one run. SI units, radians."""

    time: Array
    """(T,) s, stamps of the scans, increasing. T counts the matcher's context scans, which come
    first, as well."""
    latitude: Array
    """(T,) rad, where the navigator believes each scan was taken."""
    longitude: Array
    """(T,) rad."""
    velocity: Array
    """(T, 2) m/s, the navigator's north and east velocity at each scan."""
    reading: Array
    """(T,) reduced readings in the map's unit; NaN = no reading at this scan."""
    sigma: Array
    """(T,) 1-sigma white noise of each reading, map's unit."""
    offset: Array
    """(T,) known amount added to the map's value before it is compared with the reading."""
    transition: Array
    """(T, 2, 4) position error (north, east; m) at scan t per unit of xi."""
    reading_jacobian: Array
    """(T, 4) d(reading)/d(xi) that comes from the reduction with the navigator's wrong velocity
    and latitude, not from the map: with the navigator at error xi, reading = map(true position) +
    offset + reading_jacobian @ xi + noise."""
    nuisance_position: Array
    """(T, 2, M) position error (m) at scan t that xi does not explain, per unit-variance component
    of M: the navigator's tilt and heading bend its path by metres within a batch. M may be 0."""
    nuisance_reading: Array
    """(T, M) d(reading) of the same components, by the reduction."""
    prior: Array
    """(4, 4) covariance of xi according to the navigator; its mean is zero."""
    new: int
    """How many of the last scans no earlier batch has used (stride of overlapping batches; T where
    they do not overlap)."""
    back_transition: Array | None = None
    """(4, 4), or (7, 4) with attitude (rad): error at the last scan before the new ones, where an
    earlier batch ended, per unit of xi; None = not known."""
    back_nuisance: Array | None = None
    """(4 or 7, M) that error per unit-variance component of M."""
    attitude: tuple[Array, Array] | None = None
    """((3, 4), (3, M)) attitude error (rad) at the batch end per unit of xi and of the components
    of M."""
    channel: Integers | None = None
    """(T,) which of the maps of a `ChannelMap` each row is compared with; None = there is one map.
    Rows are then scans times channels, and the rows of a scan, one after the other, share its
    stamp."""
    of_one_potential: tuple[str, ...] | None = None
    """Components of the gravity gradient tensor, one for each channel, where the errors of their
    maps come from one wrong potential (`isogal.maps.error_model`): sigma and length of the map's
    error are then those of dd; None = the channels' errors are independent."""
    backward: Array | None = None
    """(T, 7, 7), or (T, 4, 4) without attitude: error at each scan per unit of error at the batch
    end; None = not known."""
    beam: Integers | None = None
    """(T,) which of the beams of a sounder each row is of: rows of a scan share its stamp, and
    each has the place that its beam has met; None = a scan is one row, or one for each channel."""
    parameters: Parameters | None = None
    """Constants that the readings contain and that the matcher estimates along; None = none."""
    reading_covariance: Array | None = None
    """(T, T) covariance of the sensor's noise, where the channels of a scan are correlated, or
    readings one after the other; None = diag(sigma²)."""
    noise: Parameters | None = None
    """The same as states: what readings have in common. The rest of their variance is white; None
    = all of it."""
    reading_rate: Array | None = None
    """(T,) by how much what the reduction adds to a reading changes per s along the path, map's
    unit; None = not at all."""
    delay_sigma: float = 0.0
    """1-sigma of a delay of the readings beyond what is told, s."""
    bias_walk: float = 0.0
    """Random walk of the readings' bias, map's unit per root second."""
    filter_path: FilterPath | None = None
    """What of the path each reading is a mean over; None = a point."""
    cut: int = 0
    """How many of the first rows were taken before a gap in the inertial data: what `transition`
    and the nuisance parameters say of them is not by `backward` alone."""
    end_place: tuple[float, float] | None = None
    """(rad, rad) latitude and longitude where the navigator believes to be at the stamp of the
    last scan, where readings are late and `latitude`, `longitude`, `velocity` and transitions are
    those of what they tell of; None = those of the last row."""
    correction: Array | None = None
    """(7,) change of the navigator's estimate since the last batch; None = not known."""
    beside: "tuple[Beside, ...]" = ()
    """What other fields have read up to the same end."""

    def __len__(self) -> int:
        return self.time.shape[0]

    @property
    def end(self) -> tuple[float, float]:
        """Latitude and longitude (rad) where the navigator believes to be at the batch end."""
        return self.end_place or (float(self.latitude[-1]), float(self.longitude[-1]))

    @property
    def scan_time(self) -> Array:
        """Stamps of the scans, each once."""
        each = self.channel if self.beam is None else self.beam
        return self.time if each is None else self.time[each == 0]

    @property
    def rows_per_scan(self) -> int:
        """How many rows share the stamp of a scan."""
        each = self.channel if self.beam is None else self.beam
        return 1 if each is None else int(each.max()) + 1

    def part(self, rows: int | Integers) -> "Batch":
        """Return the batch with some of its rows only: from a first one on, or those of (K,)
        indices. How many of them are new is kept; what other fields have read is not.
        """
        which = np.arange(rows, len(self)) if isinstance(rows, int) else rows
        covariance, path = self.reading_covariance, self.filter_path
        return replace(
            self,
            **{name: getattr(self, name)[which] for name in PER_ROW},
            reading_rate=None if self.reading_rate is None else self.reading_rate[which],
            backward=None if self.backward is None else self.backward[which],
            channel=None if self.channel is None else self.channel[which],
            beam=None if self.beam is None else self.beam[which],
            parameters=None if self.parameters is None else self.parameters.part(which),
            noise=None if self.noise is None else self.noise.part(which),
            reading_covariance=None if covariance is None else covariance[np.ix_(which, which)],
            filter_path=None if path is None else path.part(which),
            cut=int((which < self.cut).sum()),
            beside=(),
        )

    def back(self, elapsed: float) -> tuple[Array, Array]:
        """Return `back_transition` and `back_nuisance`, (4 or 7, 4 or M); where not known those
        of a straight line over a time (s).
        """
        if self.back_transition is not None and self.back_nuisance is not None:
            return self.back_transition, self.back_nuisance
        straight = np.eye(4)
        straight[:2, 2:] = -elapsed * np.eye(2)
        return straight, np.zeros((4, self.nuisance_reading.shape[1]))


PER_ROW = (
    "time",
    "latitude",
    "longitude",
    "velocity",
    "reading",
    "sigma",
    "offset",
    "transition",
    "reading_jacobian",
    "nuisance_position",
    "nuisance_reading",
)
"""Arrays of a `Batch` that have a row for each scan."""


@dataclass(frozen=True, slots=True, eq=False)
class Beside:
    """The batch of another field."""

    field: int
    """Its place in the list of fields."""
    batch: Batch
    """Of the same navigator, and with the same end."""
    field_map: Any
    """What it is matched against."""


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
    """None = published; else one line saying why the batch gives no fix."""
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
    them; None = they have not, or the map is not one of gravity."""
    scan_position: Array | None = None
    """(T, 2) rad, latitude and longitude of each scan, for retrodiction; None = only the last
    scan."""
    scan_covariance: Array | None = None
    """(T, 2, 2) m², north-east, such that the T fixes together hold the information of
    `covariance` once."""
    scan_information: "tuple[Information | None, ...] | None" = None
    """T shares of `information`, each about the error at its own scan and relative to the estimate
    there of a navigator that has taken the shares of earlier scans; None = positions say all."""

    @property
    def candidates(self) -> Candidates | None:
        """Where the map has the readings' values; None where that is not known."""
        return None if self.shown is None else self.shown()

    @property
    def published(self) -> bool:
        """Whether the navigator may use it."""
        return self.reason is None

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


class Matcher(Protocol):
    """A matching algorithm. Holds settings only; what it carries from batch to batch is the memory
    it returns.
    """

    @property
    def name(self) -> str:
        """As scenarios name it."""
        ...

    @property
    def context(self) -> int:
        """How many scans before the batch it wants to see as well (rows of the batch that are not
        new).
        """
        ...

    @property
    def takes_channels(self) -> bool:
        """Whether it matches readings of several channels against a `ChannelMap`."""
        ...

    def match(self, batch: Batch, field_map: Any, memory: Any) -> tuple[Fix, Any]:
        """Match one batch of one run; ``memory`` is None for a run's first batch, then what the
        last call returned.

        The map is a `FieldMap`; for readings of several channels a `ChannelMap`, which not every
        matcher takes (`takes_channels`).

        Pure: the same batch, map and memory give the same fix. Should not raise on odd
        data but decline with a reason; those who ask it decline for it (`failures`).
        """
        ...


def declined(batch: Batch, reason: str, **diagnostics: float) -> Fix:
    """Build the fix of a batch that gives none."""
    return Fix(
        time=float(batch.time[-1]),
        latitude=batch.end[0],
        longitude=batch.end[1],
        covariance=np.full((2, 2), np.nan),
        reason=reason,
        diagnostics=diagnostics,
    )
