"""Records of runs, for evaluation: arrays with the run axis first.

One type serves a single run (R = 1) and a Monte Carlo. Chunks of runs are joined by
`Runs.concatenate` and kept on disk by `Runs.save`."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array, Booleans, Integers
from isogal.errors import InputError
from isogal.files import atomic_path, reading
from isogal.fix import Candidates, Status

Texts = NDArray[np.str_]

FORMAT = 3
"""Version of the file layout; a file of another version is refused."""


@dataclass(frozen=True, slots=True, eq=False)
class RunDetail:
    """What only the figures of a single run need, for run 0 of the record. SI units, radians.

    Candidates of all batches are in one list of N, each with its batch and its weight."""

    scan_time: Array
    """(S,) s."""
    reading: Array
    """(S,) reduced readings, map's unit; NaN = none."""
    map_value: Array
    """(S,) the map's value at the true position of the scan, known offset included: the signal
    without noise."""
    map_value_navigator: Array
    """(S,) the same at the navigator's position."""
    candidate_latitude: Array
    """(N,) rad."""
    candidate_longitude: Array
    """(N,) rad."""
    candidate_weight: Array
    """(N,) association probability within its scan."""
    candidate_batch: Integers
    """(N,) index into the record's fix_time."""

    @staticmethod
    def flatten(candidates: Sequence[Candidates | None]) -> dict[str, Any]:
        """Return the four candidate fields from the candidates of each batch in turn (None = the
        batch has none)."""
        present = [(batch, c) for batch, c in enumerate(candidates) if c is not None]
        batches = np.array([batch for batch, _ in present], dtype=np.int64)
        none = np.empty(0)
        return {
            "candidate_latitude": np.concatenate([none, *(c.latitude for _, c in present)]),
            "candidate_longitude": np.concatenate([none, *(c.longitude for _, c in present)]),
            "candidate_weight": np.concatenate([none, *(c.weight for _, c in present)]),
            "candidate_batch": np.repeat(batches, [c.latitude.size for _, c in present]),
        }


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """R runs of one scenario: K navigation states and B batch ends each. Errors are estimate minus
    truth, north and east, m."""

    time: Array
    """(K,) s, increasing."""
    latitude: Array
    """(K,) rad, truth."""
    longitude: Array
    """(K,) rad, truth."""
    error: Array
    """(R, K, 2) m, the aided navigator."""
    covariance: Array
    """(R, K, 2, 2) m², the aided navigator's covariance of its error."""
    unaided_error: Array
    """(R, K, 2) m, the same inertial data without aiding."""
    fix_time: Array
    """(B,) s, last scan of each batch."""
    fix_error: Array
    """(R, B, 2) m, fix minus truth; NaN where the batch gave none."""
    fix_covariance: Array
    """(R, B, 2, 2) m², of the measurements alone; NaN where the batch gave none."""
    fix_status: Texts
    """(R, B) values of `isogal.fix.Status`."""
    fix_reason: Texts
    """(R, B) why the batch gave no fix, or the navigator did not use it; empty where it did."""
    posterior_error: Array
    """(R, B, 2) m, the navigator right after each batch end."""
    posterior_covariance: Array
    """(R, B, 2, 2) m²."""
    fix_seconds: Array
    """(R, B) s, computing time of each batch."""
    detail: RunDetail | None = None
    """Extras for the figures of run 0."""
    smoothed_error: Array | None = None
    """(R, K, 2) m, of the states as all data of the voyage have them; None = not smoothed."""
    smoothed_covariance: Array | None = None
    """(R, K, 2, 2) m²."""

    def __post_init__(self) -> None:
        if ((self.fix_reason == "") != self.published).any():
            raise ValueError("fix_reason must be empty where a fix was published, and only there")

    def __len__(self) -> int:
        return self.error.shape[0]

    @property
    def elapsed(self) -> Array:
        """(K,) s since the first state."""
        return self.time - self.time[0]

    @property
    def smoothed(self) -> "Runs | None":
        """The runs with smoothed states in place of those of the time."""
        error, covariance = self.smoothed_error, self.smoothed_covariance
        if error is None or covariance is None:
            return None
        return replace(self, error=error, covariance=covariance)

    @property
    def horizontal_error(self) -> Array:
        """(R, K) m, distance of the aided navigator from the truth."""
        return cast(Array, np.hypot(self.error[..., 0], self.error[..., 1]))

    @property
    def unaided_horizontal_error(self) -> Array:
        """(R, K) m, distance of the unaided navigator from the truth."""
        return cast(Array, np.hypot(self.unaided_error[..., 0], self.unaided_error[..., 1]))

    @property
    def rms(self) -> Array:
        """(K,) m, of the aided navigators' distances over the runs."""
        return np.sqrt(np.mean(self.horizontal_error**2, axis=0))

    @property
    def unaided_rms(self) -> Array:
        """(K,) m, of the unaided navigators' distances over the runs."""
        return np.sqrt(np.mean(self.unaided_horizontal_error**2, axis=0))

    @property
    def published(self) -> Booleans:
        """(R, B) whether the batch gave a fix that the navigator used."""
        return np.asarray(self.fix_status == Status.FIX.value)

    @property
    def fix_place(self) -> tuple[Array, Array]:
        """(B,) rad, true latitude and longitude at the batch ends, the longitude unwrapped."""
        longitude = np.interp(self.fix_time, self.time, np.unwrap(self.longitude))
        return np.interp(self.fix_time, self.time, self.latitude), longitude

    def part(self, which: Sequence[int]) -> "Runs":
        """Return some of the runs, by their places in the record; the detail stays only where the
        first of them is the first here."""
        own = {name: array[list(which)] for name, array in _arrays(self) if name not in _SHARED}
        detail = self.detail if list(which[:1]) == [0] else None
        return replace(self, **own, detail=detail)

    @staticmethod
    def concatenate(parts: Sequence["Runs"]) -> "Runs":
        """Join records of the same scenario along the run axis, in the order given; the detail is
        that of the first part.

        Raises
        ------
        ValueError
            Nothing to join, or the parts differ in time, truth or batch ends.
        """
        if not parts:
            raise ValueError("no runs to join")
        first = parts[0]
        for name in _SHARED:
            if not all(np.array_equal(getattr(first, name), getattr(p, name)) for p in parts):
                raise ValueError(f"runs of different scenarios cannot be joined: {name} differs")
        per_run = (name for name, _ in _arrays(first) if name not in _SHARED)
        joined = {name: np.concatenate([getattr(p, name) for p in parts]) for name in per_run}
        return replace(first, **joined, detail=first.detail)

    def save(self, path: str | Path) -> None:
        """Write a compressed npz. The file appears whole or not at all, even if the writer
        dies."""
        arrays = dict(_arrays(self))
        if self.detail is not None:
            arrays |= {_OF_DETAIL + name: array for name, array in _arrays(self.detail)}
        with atomic_path(path) as temporary, temporary.open("wb") as stream:
            np.savez_compressed(stream, format=np.array(FORMAT), **arrays)

    @staticmethod
    def load(path: str | Path) -> "Runs":
        """Read what `save` wrote.

        Raises
        ------
        InputError
            The file is missing, damaged, or of another format version.
        """
        with reading(path, "a record of runs"), np.load(path, allow_pickle=False) as stored:
            if (version := int(stored["format"])) != FORMAT:
                raise InputError(f"{path}: has format {version} of records, not {FORMAT}")
            own = {name: stored[name] for name in _names(Runs) if name in stored}
            names = {name: _OF_DETAIL + name for name in _names(RunDetail)}
            detail = None
            if all(key in stored for key in names.values()):
                detail = RunDetail(**{name: stored[key] for name, key in names.items()})
            return Runs(**own, detail=detail)


def _names(record: type[RunDetail] | type[Runs]) -> list[str]:
    """Return the names of a record's arrays."""
    return [one.name for one in fields(record) if one.name != "detail"]


def _arrays(record: RunDetail | Runs) -> list[tuple[str, Any]]:
    """Return the arrays that a record has, by name."""
    every = ((name, getattr(record, name)) for name in _names(type(record)))
    return [(name, array) for name, array in every if array is not None]


_OF_DETAIL = "detail_"
_SHARED = ("time", "latitude", "longitude", "fix_time")
"""Arrays of a record that all its runs share; of the others each has its own."""
