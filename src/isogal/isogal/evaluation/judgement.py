"""Runs judged by what their user loses (docs/mathematics.md, section 11.4): is a run better than
without aiding, and is its error what the navigator claims?"""

import numpy as np

from isogal.arrays import Booleans
from isogal.evaluation.consistency import nees_per_axis
from isogal.evaluation.records import Runs

SETTLED_AFTER = 3600.0
"""s; figures "after 1 h" are of the time after this."""
CLAIMED_SIGMAS = 5.0
"""An error outside of so many sigmas of the navigator's own covariance is one that its user cannot
expect: for a consistent navigator once in 270,000."""
CLAIM_WINDOW = 600.0
"""s that an error has to stay outside."""


KINDS = {
    "unaided": "without any fix",
    "worse_than_unaided": "worse than unaided",
    "overconfident": "beyond 5 claimed sigmas for 10 min",
    "diverged": "diverged (2 km at the end)",
}
"""Ways in which a run lets its user down, in words: no fix was published at all, which is no
success of the matcher; the RMS error after the first hour is above that of the unaided navigator
in spite of fixes, or rather because of them; the error is outside of `CLAIMED_SIGMAS` for
`CLAIM_WINDOW` at a stretch; the paper's 2 km (`isogal.evaluation.summary.diverged`)."""


def judge(runs: Runs, diverged: Booleans) -> dict[str, Booleans]:
    """Return which of R runs are `good` and which have let their user down, by `KINDS`, (R,) each,
    given which have diverged."""
    unaided = np.asarray(~runs.published.any(axis=1))
    worse, overconfident = ~unaided & ~_better_than_unaided(runs), _beyond_claim(runs)
    return {
        "good": ~(unaided | worse | overconfident | diverged),
        "unaided": unaided,
        "worse_than_unaided": worse,
        "overconfident": overconfident,
        "diverged": diverged,
    }


def _better_than_unaided(runs: Runs) -> Booleans:
    """Return (R,) whether the RMS error after the first hour, or of the whole run where it is
    shorter, is at most that of the unaided navigator, at the states where that is recorded."""
    settled = runs.elapsed > SETTLED_AFTER
    part = settled if settled.any() else slice(None)
    aided, unaided = runs.horizontal_error[:, part], runs.unaided_horizontal_error[:, part]
    recorded = np.isfinite(unaided)
    of_aided, of_unaided = ((error**2).sum(axis=1, where=recorded) for error in (aided, unaided))
    return np.asarray(of_aided <= of_unaided)


def _beyond_claim(runs: Runs) -> Booleans:
    """Return (R,) whether the error is outside of the claimed sigmas at all states of some window;
    an error that is not finite counts as outside."""
    squared = 2.0 * nees_per_axis(runs.error, runs.covariance)
    outside = ~(squared <= CLAIMED_SIGMAS**2)
    states = np.arange(runs.time.size)
    inside = np.maximum.accumulate(np.where(outside, -1, states), axis=1)  # the last one
    begun = runs.elapsed[np.minimum(inside + 1, states[-1])]
    return (outside & (runs.elapsed - begun >= CLAIM_WINDOW)).any(axis=1)
