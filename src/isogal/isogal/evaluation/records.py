"""Records of runs, for evaluation: arrays with the run axis first.

One type serves a single run (R = 1) and a Monte Carlo. Chunks of runs are joined by
`Runs.concatenate` and kept on disk by `Runs.save`."""

import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array, Booleans, Integers
from isogal.errors import InputError
from isogal.files import atomic_path
from isogal.matching.interfaces import Candidates

Reasons = tuple[tuple[str | None, ...], ...]

FORMAT = 1
"""Version of the file layout; a file of another version is refused."""
_DETAIL_PREFIX = "detail_"


PER_RUN = (
    "error",
    "covariance",
    "unaided_error",
    "fix_error",
    "fix_covariance",
    "fix_reason",
    "posterior_error",
    "posterior_covariance",
    "fix_seconds",
)
"""Arrays of a record that every run has one of; others are kept of one run only, or shared."""


@dataclass(frozen=True, slots=True, eq=False)
class RunDetail:
    """What only the figures of a single run need, for run 0 of the record. SI units, radians.

    Candidates of all batches are in one list of N, each with its batch, its scan within the batch
    and its weight."""

    scan_time: Array
    """(S,) s."""
    reading: Array
    """(S,) reduced readings, map's unit; NaN = none."""
    map_value: Array
    """(S,) the map's value at the true position of the scan, known offset included: the signal
    without noise."""
    map_value_navigator: Array
    """(S,) the same at the navigator's position."""
    feature_variability: Array
    """(S,) map feature variability as the matcher reported it, in its own unit, at the last scan
    of a batch; NaN elsewhere."""
    candidate_latitude: Array
    """(N,) rad."""
    candidate_longitude: Array
    """(N,) rad."""
    candidate_weight: Array
    """(N,) association probability within its scan."""
    candidate_batch: Integers
    """(N,) index into the record's fix_time."""
    candidate_scan: Integers
    """(N,) index of the scan in its batch."""

    def __post_init__(self) -> None:
        scans, candidates = self.scan_time.shape, self.candidate_batch.shape
        for name in ("reading", "map_value", "map_value_navigator", "feature_variability"):
            _expect(name, getattr(self, name), scans)
        for name in (
            "candidate_latitude",
            "candidate_longitude",
            "candidate_weight",
            "candidate_scan",
        ):
            _expect(name, getattr(self, name), candidates)

    @staticmethod
    def flatten(candidates: Sequence[Candidates | None]) -> dict[str, Any]:
        """Return the five candidate fields from the candidates of each batch in turn (None = the
        batch has none)."""
        present = [(batch, c) for batch, c in enumerate(candidates) if c is not None]
        kinds = {"latitude": float, "longitude": float, "weight": float, "scan": np.int64}
        found: dict[str, Any] = {
            f"candidate_{name}": np.concatenate(
                [
                    np.empty(0, dtype=kind),
                    *(np.asarray(getattr(c, name), kind) for _, c in present),
                ]
            )
            for name, kind in kinds.items()
        }
        batches = np.array([batch for batch, _ in present], dtype=np.int64)
        found["candidate_batch"] = np.repeat(batches, [c.latitude.size for _, c in present])
        return found


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
    fix_reason: Reasons
    """Per run, per batch: None = published, else why not."""
    posterior_error: Array
    """(R, B, 2) m, the navigator right after each batch end."""
    posterior_covariance: Array
    """(R, B, 2, 2) m²."""
    fix_seconds: Array
    """(R, B) s, computing time of each batch."""
    detail: RunDetail | None = None
    """Extras for the figures of run 0."""

    def __post_init__(self) -> None:
        if self.error.ndim != 3:
            raise ValueError(f"error must have shape (R, K, 2), has {self.error.shape}")
        runs, states, batches = self.error.shape[0], self.time.size, self.fix_time.size
        shapes: dict[str, tuple[int, ...]] = {
            "time": (states,),
            "latitude": (states,),
            "longitude": (states,),
            "error": (runs, states, 2),
            "covariance": (runs, states, 2, 2),
            "unaided_error": (runs, states, 2),
            "fix_time": (batches,),
            "fix_error": (runs, batches, 2),
            "fix_covariance": (runs, batches, 2, 2),
            "posterior_error": (runs, batches, 2),
            "posterior_covariance": (runs, batches, 2, 2),
            "fix_seconds": (runs, batches),
        }
        for name, shape in shapes.items():
            _expect(name, getattr(self, name), shape)
        if len(self.fix_reason) != runs or any(
            len(reasons) != batches for reasons in self.fix_reason
        ):
            raise ValueError(f"fix_reason must hold {runs} tuples of {batches} reasons")
        if any(reason == "" for reasons in self.fix_reason for reason in reasons):
            raise ValueError("fix_reason: a reason must not be empty (None = published)")

    def __len__(self) -> int:
        return self.error.shape[0]

    @property
    def elapsed(self) -> Array:
        """(K,) s since the first state."""
        return self.time - self.time[0]

    @property
    def horizontal_error(self) -> Array:
        """(R, K) m, distance of the aided navigator from the truth."""
        return cast(Array, np.hypot(self.error[..., 0], self.error[..., 1]))

    @property
    def unaided_horizontal_error(self) -> Array:
        """(R, K) m, distance of the unaided navigator from the truth."""
        return cast(Array, np.hypot(self.unaided_error[..., 0], self.unaided_error[..., 1]))

    @property
    def published(self) -> Booleans:
        """(R, B) whether the batch gave a fix."""
        flags = [[reason is None for reason in reasons] for reasons in self.fix_reason]
        return np.array(flags, dtype=np.bool_).reshape(len(self), self.fix_time.size)

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
        shared = ("time", "latitude", "longitude", "fix_time")
        for part in parts[1:]:
            for name in shared:
                if not np.array_equal(getattr(first, name), getattr(part, name)):
                    raise ValueError(
                        f"runs of different scenarios cannot be joined: {name} differs"
                    )
        joined: dict[str, Any] = {name: getattr(first, name) for name in shared}
        for item in fields(Runs):
            if item.name not in (*shared, "fix_reason", "detail"):
                joined[item.name] = np.concatenate([getattr(part, item.name) for part in parts])
        reasons = tuple(reasons for part in parts for reasons in part.fix_reason)
        return Runs(**joined, fix_reason=reasons, detail=first.detail)

    def save(self, path: str | Path) -> None:
        """Write a compressed npz. The file appears whole or not at all, even if the writer
        dies."""
        arrays: dict[str, Any] = {"format": np.array(FORMAT)}
        for item in fields(self):
            if item.name not in ("fix_reason", "detail"):
                arrays[item.name] = getattr(self, item.name)
        texts = [[reason or "" for reason in reasons] for reasons in self.fix_reason]
        arrays["fix_reason"] = np.array(texts, dtype=np.str_).reshape(
            len(self), self.fix_time.size
        )
        if self.detail is not None:
            arrays |= {
                _DETAIL_PREFIX + item.name: getattr(self.detail, item.name)
                for item in fields(self.detail)
            }
        with atomic_path(path) as temporary, temporary.open("wb") as stream:
            np.savez_compressed(stream, **arrays)

    @staticmethod
    def load(path: str | Path) -> "Runs":
        """Read what `save` wrote.

        Raises
        ------
        InputError
            The file is missing, damaged, or of another format version.
        """
        try:
            with np.load(path, allow_pickle=False) as stored:
                arrays = {name: stored[name] for name in stored.files}
            return _from_arrays(arrays)
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
        except (
            ValueError,
            KeyError,
            TypeError,
            EOFError,
            zipfile.BadZipFile,
            zlib.error,
        ) as error:
            raise InputError(f"{path}: not a record of runs of format {FORMAT}: {error}") from None


def _from_arrays(arrays: Mapping[str, Any]) -> Runs:
    version = int(arrays["format"])
    if version != FORMAT:
        raise ValueError(f"it has format {version}")
    reasons = tuple(tuple(str(text) or None for text in row) for row in arrays["fix_reason"])
    detail = None
    if _DETAIL_PREFIX + "scan_time" in arrays:
        detail = RunDetail(
            **{item.name: arrays[_DETAIL_PREFIX + item.name] for item in fields(RunDetail)}
        )
    plain = {
        item.name: arrays[item.name]
        for item in fields(Runs)
        if item.name not in ("fix_reason", "detail")
    }
    return Runs(**plain, fix_reason=reasons, detail=detail)


def _expect(name: str, value: NDArray[Any], shape: tuple[int, ...]) -> None:
    if value.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, has {value.shape}")
