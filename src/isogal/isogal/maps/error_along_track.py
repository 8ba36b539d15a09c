"""A map's error along a track as a Gauss-Markov process, scan by scan, where errors depend on each
other: those of the channels of one potential, under the beams of a sounder, and after a low-pass
filter (docs/mathematics.md, section 5.2)."""

from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.maps.tensor_error import shares, tensor_covariance

LEAST_STEP_M, NUGGET = 1.0, 1e-6
"""Nearer to the scan before map errors are the same; share of their variance that is each one's
own, against rounding."""


class Chain(NamedTuple):
    """Map errors of a scan that depend on each other."""

    order: int
    """Scans that say what the next one's are."""
    places: Array
    """(K, 2) m, north and east, of where they are in a scan."""
    names: tuple[str, ...] | None
    """Tensor components of one potential; None = one map."""

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
    """Return how a chain of U map errors goes on along a track, u -> step u with `joined` added to
    their covariance, in units of their 1-sigma.

    Parameters
    ----------
    chain : Chain, optional
        None = errors do not depend on each other, and U is 0.
    moved : (n, 2) array
        m north and east of each row from the one before.
    before : (order, 2) array
        The same of the last scans.
    lengths : (L,) array
        Correlation lengths, m.
    begins : bool
        Whether the first row is the first of all.

    Returns
    -------
    steps : (order, 2) array
        `before` of the next rows.
    step, joined : (L, n, U, U) arrays
        0 where a row is at the place of the one before.

    Notes
    -----
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
    """Return `step` and `joined` (L, n, 2, 2) as `chained` does of a map's error after a low-pass
    filter with a memory (m), f, and as it is, m, over distances (n,): f' = (m - f) / memory and m
    a Gauss-Markov process, both stationary."""
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
