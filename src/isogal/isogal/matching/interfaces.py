"""What a matcher is given and what it gives back.

A batch is T scans of one sensor with the navigator's own estimate of where each was taken. The
unknown is x, the navigator's error at the batch end: position (north, east; m), velocity (m/s) and
attitude (about north, east, down; rad), estimate minus truth. Over a batch the navigator's
increments are good to about a metre (docs/mathematics.md, section 4.1), so the position error at a
scan is linear in x, and so is what the navigator's error does to a reading by its reduction:

    reading = map(place - by_error[:2] x - apart[:2] e) + by_error[2] x + apart[2] e + noise,
    x ~ N(0, covariance), e ~ N(0, I).

Matchers that know of position and velocity only, xi = x[:4], have the same given xi:
`Batch.prior`, `transition`, `reading_jacobian`, and `nuisance` of what xi does not explain. A
matcher answers with a fix of the measurements alone, without the navigator's prior."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.frames import displaced
from isogal.fix import LOST_COVARIANCE, LOST_SIGMA, Candidates, Fix, Information, Status
from isogal.maps.channels import AnyMap
from isogal.matching.parameters import InstrumentErrors
from isogal.matching.transitions import given_position_and_velocity
from isogal.passage import History

__all__ = [
    "LOST_COVARIANCE",
    "LOST_SIGMA",
    "Batch",
    "Candidates",
    "Fix",
    "Information",
    "Layout",
    "Matcher",
    "SecondaryBatch",
    "Status",
    "declined",
    "located",
    "with_scans",
]


SATELLITES = "satellites say more than the map"
"""Why there is no fix where none is wanted."""


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Which number of a scan each row of a batch is: rows are scans times channels or beams, and
    those of a scan, one after the other, share its stamp."""

    index: Integers
    """(T,) channel, whose map of a `ChannelMap` the row is compared with; or beam of a sounder,
    and the row has the place that it has met."""
    beams: bool = False
    """Whether rows are of beams, not of channels."""
    of_one_potential: tuple[str, ...] | None = None
    """Components of the gravity gradient tensor, one for each channel, where the errors of their
    maps come from one wrong potential (`isogal.maps.error_model`): sigma and length of the map's
    error are then those of dd; None = the channels' errors are independent."""

    @property
    def rows(self) -> int:
        """Of a scan."""
        return int(self.index.max()) + 1

    def part(self, rows: Integers) -> "Layout":
        """Return that of some rows."""
        return replace(self, index=self.index[rows])


@dataclass(frozen=True, eq=False)
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
    """(T,) reduced readings in the map's unit, less what is known to be wrong with them; NaN = no
    reading at this scan."""
    sigma: Array
    """(T,) 1-sigma of what of a reading's noise it has in common with no other, map's unit; the
    rest is among the parameters of the `instrument`."""
    covariance: Array
    """(7, 7) of x according to the navigator; its mean is zero."""
    by_error: Array
    """(T, 3, 7) position error at each scan (north, east; m), and what the reduction with the
    navigator's wrong velocity and latitude adds to its reading, per unit of x."""
    backward: Array
    """(T, 7, 7) error at each scan's stamp per unit of x, but for what a gap in the inertial data
    adds."""
    new: int
    """How many of the last scans no earlier batch has used (stride of overlapping batches; T where
    they do not overlap)."""
    apart: Array | None = None
    """(T, 3, K) what x does not explain of the same, per unit-variance component of K: of a gap in
    the inertial data, of gravity that is not compensated; None = K is 0."""
    layout: Layout | None = None
    """What the rows of a scan are; None = a scan is one row."""
    instrument: InstrumentErrors = field(default_factory=InstrumentErrors)
    """What is known of the readings beside their white noise."""
    history: History = field(default_factory=History)
    """What has become of the navigator since the last batch."""
    cut: int = 0
    """How many of the first rows were taken before a gap in the inertial data: what x says of them
    is not by `backward` alone."""
    end_place: tuple[float, float] | None = None
    """(rad, rad) latitude and longitude where the navigator believes to be at the stamp of the
    last scan, where readings are late and `latitude`, `longitude`, `velocity` and what x does to
    them are those of when they were sensed; None = those of the last row."""
    secondary: "tuple[SecondaryBatch, ...]" = ()
    """What other fields have read up to the same end."""

    def __len__(self) -> int:
        return self.time.shape[0]

    @property
    def end(self) -> tuple[float, float]:
        """Latitude and longitude (rad) where the navigator believes to be at the batch end."""
        return self.end_place or (float(self.latitude[-1]), float(self.longitude[-1]))

    @property
    def channel(self) -> Integers | None:
        """(T,) which of the maps of a `ChannelMap` each row is compared with; None = there is one
        map."""
        return None if self.layout is None or self.layout.beams else self.layout.index

    @property
    def scan_time(self) -> Array:
        """Stamps of the scans, each once."""
        return self.time if self.layout is None else self.time[self.layout.index == 0]

    @property
    def rows_per_scan(self) -> int:
        """How many rows share the stamp of a scan."""
        return 1 if self.layout is None else self.layout.rows

    @property
    def prior(self) -> Array:
        """(4, 4) covariance of xi."""
        return self.covariance[:4, :4]

    @property
    def transition(self) -> Array:
        """(T, 2, 4) position error (north, east; m) at each scan per unit of xi."""
        return self._given_xi[0][:, :2]

    @property
    def reading_jacobian(self) -> Array:
        """(T, 4) what the reduction adds to a reading per unit of xi."""
        return self._given_xi[0][:, 2]

    @property
    def nuisance(self) -> Array:
        """(T, 3, M) position error (m) at each scan and reading that xi does not explain, per
        unit-variance component of M: the navigator's tilt and heading bend its path by metres
        within a batch."""
        return self._given_xi[1]

    @cached_property
    def _given_xi(self) -> tuple[Array, Array]:
        """(T, 3, 4) position error and reading per unit of xi, (T, 3, M) what it leaves."""
        apart = np.zeros((len(self), 3, 0)) if self.apart is None else self.apart
        return given_position_and_velocity(self.by_error, self.covariance, apart)

    def part(self, rows: int | Integers) -> "Batch":
        """Return the batch with some of its rows only: from a first one on, or those of (K,)
        indices, each as often as it is there. How many of them are new is kept; what other fields
        have read is not.
        """
        which = np.arange(rows, len(self)) if isinstance(rows, int) else rows
        columns: dict[str, Any] = {}
        for name in PER_ROW:
            column = getattr(self, name)
            columns[name] = None if column is None else column[which]
        return replace(
            self,
            **columns,
            layout=None if self.layout is None else self.layout.part(which),
            instrument=self.instrument.part(which),
            cut=int((which < self.cut).sum()),
            secondary=(),
        )


PER_ROW = (
    "time",
    "latitude",
    "longitude",
    "velocity",
    "reading",
    "sigma",
    "by_error",
    "apart",
    "backward",
)
"""Arrays of a `Batch` that have a row for each scan."""


@dataclass(frozen=True, slots=True, eq=False)
class SecondaryBatch:
    """The batch of another field."""

    field: int
    """Its place in the list of fields."""
    batch: Batch
    """Of the same navigator, and with the same end."""
    field_map: AnyMap
    """What it is matched against."""


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

    def match(self, batch: Batch, field_map: AnyMap, memory: Any) -> tuple[Fix, Any]:
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


def located(batch: Batch, error: Array, covariance: Array, **more: Any) -> Fix:
    """Build the fix of a batch at whose end the navigator was off by an error (2,), m north and
    east, of covariance (2, 2), m²; more fields as `Fix` has them."""
    latitude, longitude = displaced(*batch.end, -error)
    time = float(batch.time[-1])
    return Fix(time, float(latitude), float(longitude), covariance, **more)


def with_scans(fix: Fix, batch: Batch, moved: Array) -> Fix:
    """Return the fix of a batch with the place of each scan, where the navigator was off by
    `moved` (T, 2), m north and east. Late readings say where the vehicle was, not where it is at
    their stamps."""
    if batch.end_place is not None:
        return fix
    places = displaced(batch.latitude, batch.longitude, -moved)
    covariance = np.full((len(batch), 2, 2), np.nan)
    # as many fixes together hold the information once
    covariance[len(batch) - batch.new :] = batch.new * fix.covariance
    return replace(fix, scan_position=np.stack(places, axis=-1), scan_covariance=covariance)
