"""How the navigator's error goes on from one batch end to the next, as its covariances say
(docs/mathematics.md, section 6.2)."""

from typing import NamedTuple

import numpy as np

from isogal.arrays import Array


class Step(NamedTuple):
    """An error x becomes `forward` x, and `growth` joins its covariance."""

    forward: Array
    """(7, 7)."""
    growth: Array
    """(7, 7)."""


def steps(before: Array, back: Array, prior: Array) -> tuple[Step, Step]:
    """Return what the dynamics do, and the same with what the navigator has learnt from other
    aids, which makes every hypothesis as much narrower as the navigator.

    Parameters
    ----------
    before, prior : (7, 7) arrays
        The navigator's covariance at the last batch end after its fix, and at this one.
    back : (7, 7) array
        Error there per unit of error here.
    """
    forward = np.asarray(np.linalg.inv(back), dtype=np.float64)
    dynamic = forward @ before @ forward.T
    growth, narrower = grown(dynamic, prior)
    alone = Step(forward, growth)
    if not narrower:
        return alone, alone
    scale = np.sqrt(np.diag(prior))
    unit = np.outer(scale, scale)
    learnt = _transport((dynamic + growth) / unit, prior / unit) * scale[:, None] / scale
    return alone, Step(learnt @ forward, learnt @ growth @ learnt.T)


def grown(before: Array, after: Array) -> tuple[Array, bool]:
    """Return (7, 7) what has joined a covariance where it has grown, and whether it is narrower in
    some direction."""
    scale = np.sqrt(np.diag(after))
    unit = np.outer(scale, scale)
    values, vectors = np.linalg.eigh((after - before) / unit)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T * unit, bool(values[0] < -1e-9)


def _transport(a: Array, b: Array) -> Array:
    """Return the symmetric T with T a T = b: the optimal map from N(0, a) to N(0, b) (Gelbrich
    1990)."""
    values, vectors = np.linalg.eigh(a)
    root = np.sqrt(np.maximum(values, 1e-300))
    half = (vectors * root) @ vectors.T
    inverse = (vectors / root) @ vectors.T
    values, vectors = np.linalg.eigh(half @ b @ half)
    middle = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return np.asarray(inverse @ middle @ inverse)
