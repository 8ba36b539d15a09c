"""Map errors that depend on each other: those of the channels of one potential, under the beams of
a sounder, and after a low-pass filter (docs/mathematics.md, section 5.2)."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.maps.tensor_error import shares, tensor_covariance
from isogal.matching.interfaces import Batch

TENSOR_ORDER, MOST_ERRORS = 2, 24
"""Scans whose map errors of one potential say what those of the next are. Against the whole
covariance a straight track has 1.4 to 1.5 times the error with independent chains, 1.2 to 1.3 with
one scan, 1.1 to 1.2 with two, 1.1 with three. Beams need as many scans as their footprints are
long, since what is behind meets where others have been; not more than so many errors in all."""
LEAST_STEP_M, NUGGET = 1.0, 1e-6
"""Nearer to the scan before map errors are the same; share of their variance that is each one's
own, against rounding."""


def scans_underneath(batch: Batch, beams: int) -> int:
    """Return how many scans it takes until the last beam is where the first one was."""
    foot = _footprints(batch, beams)
    along = batch.velocity[-1]
    speed = math.hypot(*along)
    if not speed > 0.0:
        return 1
    extent = np.ptp(foot @ along) / speed
    interval = float(batch.time[-1] - batch.time[-1 - beams]) if len(batch) > beams else math.inf
    return max(1, min(math.ceil(extent / (speed * interval)), MOST_ERRORS // beams))


def _footprints(batch: Batch, beams: int) -> Array:
    """Return (B, 2) m north and east of the first where the beams of the batch's last scan met the
    ground."""
    last = np.arange(len(batch) - beams, len(batch))
    lat, lon = batch.latitude[last], batch.longitude[last]
    return horizontal_difference(lat, lon, lat[:1], lon[:1])


class Chain(NamedTuple):
    """Map errors of a scan that depend on each other."""

    order: int
    places: Array
    """(K, 2) m, north and east."""
    names: tuple[str, ...] | None
    """Tensor components of one potential; None = one map."""

    @classmethod
    def of(cls, batch: Batch, channels: int, order: int) -> "Chain | None":
        """Return that of a batch with so many map errors, of `order` scans; None where they do not
        depend on each other."""
        count, names = channels // order, batch.of_one_potential
        if names is not None:
            return cls(order, np.zeros((count, 2)), names)
        return None if batch.beam is None else cls(order, _footprints(batch, count), None)

    def correlation(self, apart: Array, length: float) -> Array:
        """Return (..., N, N) that of N = (order + 1) K errors, [i, j] `apart` from i to j."""
        if self.names is None:
            return np.asarray(np.exp(-np.hypot(apart[..., 0], apart[..., 1]) / length))
        every = np.tile(np.arange(len(self.names)), self.order + 1)
        unit = 1.0 / np.sqrt(shares(self.names))[every]
        return tensor_covariance(self.names, every, apart, length) * unit[:, None] * unit


def chained(
    chain: Chain | None, moved: Array, before: Array, lengths: Array, begins: bool
) -> tuple[Array, Array, Array]:
    """Return `rows.Epoch.steps` after rows that are (n, 2) m from those before, `Rows.step` and
    `Rows.joined`, given `Epoch.steps` before and whether a run begins with them.

    The covariance of map errors says what to expect of the next scan's by those of `order` scans,
    as if those before did not matter (a vector autoregression; Vecchia 1988, J. R. Stat. Soc. B
    50:297)."""
    count = len(moved)
    if chain is None:
        nothing = np.zeros((len(lengths), count, 0, 0))
        return before, nothing, nothing
    order, size = chain.order, len(chain.places)
    whole = order * size
    step, joined = (np.zeros((len(lengths), count, whole, whole)) for _ in range(2))
    if begins:
        moved = np.concatenate([before[:1], moved[1:]])
    scans = np.flatnonzero(np.hypot(*moved.T) > LEAST_STEP_M)
    trail = np.concatenate([before[1:], moved[scans]])
    back = np.stack([trail[order - 1 - k :][: len(scans)] for k in range(order)], axis=1)
    places = np.concatenate([np.zeros((len(scans), 1, 2)), -np.cumsum(back, axis=1)], axis=1)
    places = (places[:, :, None] + chain.places).reshape(len(scans), -1, 2)
    apart = places[:, None] - places[:, :, None]
    older = np.arange(size, whole)
    for k, length in enumerate(lengths):
        every = chain.correlation(apart, float(length)) + NUGGET * np.eye(whole + size)
        now, cross = every[:, :size, :size], every[:, size:, :size]
        gain = np.linalg.solve(every[:, size:, size:], cross).swapaxes(1, 2)
        step[k, scans, :size] = gain
        step[k][scans[:, None], older, older - size] = 1.0
        joined[k][scans[:, None, None], np.arange(size)[:, None], np.arange(size)] = (
            now - gain @ cross
        )
        if begins:
            step[k, 0], joined[k, 0] = 0.0, every[0, :whole, :whole]
    return np.concatenate([before, moved[scans]])[-order:], step, joined


def filtered_chain(
    memory: float, travelled: Array, lengths: Array, begins: bool
) -> tuple[Array, Array]:
    """Return `Rows.step` and `Rows.joined` of a map's error after a low-pass filter with a memory
    (m), f, and as it is, m, over distances (n,): f' = (m - f) / memory and m a Gauss-Markov
    process, both stationary."""
    step, joined = (np.zeros((len(lengths), len(travelled), 2, 2)) for _ in range(2))
    moved = travelled > LEAST_STEP_M
    for k, length in enumerate(lengths):
        s = memory if abs(memory / length - 1.0) > 1e-3 else 1.002 * memory  # else 0 / 0
        share = length / (length + s)
        stationary = np.array([[share, share], [share, 1.0]])
        old, left = np.exp(-travelled / s), np.exp(-travelled / length)
        step[k, :, 0, 0], step[k, :, 1, 1] = old, left
        step[k, :, 0, 1] = (left - old) / (1.0 - s / length)
        joined[k] = stationary - step[k] @ stationary @ step[k].swapaxes(1, 2)
        joined[k, :, 0, 0] = np.maximum(joined[k, :, 0, 0], NUGGET**2)
        if begins:
            moved[0], step[k, 0], joined[k, 0] = True, 0.0, stationary
        step[k][~moved], joined[k][~moved] = 0.0, 0.0
    return step, joined
