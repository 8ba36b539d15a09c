"""The figures of merit of a set of runs: what `results.json` holds, m, s.

`position_error` is horizontal, a mean and RMS over time and runs, both also after the first hour.
`nees_per_axis` is that of the navigator right after the published fixes, with the chi-square
interval of a consistent navigator's mean (docs/mathematics.md, section 11.3); `nees_all_scans` at
every recorded state but the start. `judgement` has the share of runs of each kind, and their
indices. `fixes` counts batches that gave a fix and that did not; of these, on which the matcher
has failed, and whose fix the navigator rejected. `smoothed` is there where the runs were smoothed:
its `bound` is of one that knows all readings, `ratio` the RMS error over it, `of_causal` over the
RMS error of the navigator at the time."""

import math
from collections import Counter
from typing import cast

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.evaluation.consistency import mean_nees, nees_per_axis
from isogal.evaluation.integrity import integrity
from isogal.evaluation.judgement import KINDS, SETTLED_AFTER, judge
from isogal.evaluation.records import Runs
from isogal.evaluation.results import Number, Summary, finite
from isogal.fix import Status
from isogal.scenario import Settings

DIVERGENCE_LIMIT = 2000.0
"""m; a run whose mean error over its last part is above this has diverged (about twice that of the
unaided INS there; docs/mathematics.md, section 11.4)."""
DIVERGENCE_WINDOW = 1800.0
"""s, length of that last part."""
OVER_TIME_STEP = 60.0
"""s between the entries of rms_over_time."""


def summarise(
    runs: Runs,
    settings: Settings,
    bound_rms: Array,
    *,
    smoothed_bound_rms: Array | None = None,
    wall_seconds: float = math.nan,
) -> Summary:
    """Return the figures of merit of runs.

    Parameters
    ----------
    runs : Runs
        At least one run.
    settings : Settings
        What they were runs of; all of it is noted.
    bound_rms : (K,) array
        m, RMS bound at `runs.time` (`BoundResult.rms_at`); NaN where not known.
    smoothed_bound_rms : (K,) array, optional
        The same of one that knows all readings (`BoundResult.smoothed_rms_at`).
    wall_seconds : float
        Wall time that the runs took; NaN = not measured.
    """
    aided, unaided = runs.horizontal_error, runs.unaided_horizontal_error
    settled, astray = runs.elapsed > SETTLED_AFTER, diverged(runs)
    judgement = judge(runs, astray)
    recorded = unaided[np.isfinite(unaided)]  # a recording may have gaps
    summary = {
        "scenario": settings.model_dump(mode="json"),
        "matcher": settings.matcher.name,
        "runs": len(runs),
        "diverged": int(astray.sum()),
        "position_error": _position_error(aided, settled),
        "unaided": {"mean": _mean(recorded), "rms": _rms(recorded)},
        "bound": {"rms": _rms(bound_rms), "rms_after_1h": _rms(bound_rms[settled])},
        "nees_per_axis": _nees(posterior_nees(runs)),
        "nees_all_scans": _nees(nees_per_axis(runs.error[:, 1:], runs.covariance[:, 1:])),
        "judgement": {
            "share": {kind: float(which.mean()) for kind, which in judgement.items()},
            "runs": {kind: np.flatnonzero(judgement[kind]).tolist() for kind in KINDS},
        },
        "integrity": integrity(runs, settings.integrity),
        "fixes": _fixes(runs),
        "time": {
            "wall_s": finite(wall_seconds),
            "fix_ms_median": finite(1e3 * _median(runs.fix_seconds)),
        },
        "rms_over_time": _rms_over_time(runs, bound_rms, aided=runs.rms, unaided=runs.unaided_rms),
    }
    if runs.smoothed is not None:
        summary["smoothed"] = _smoothed(runs, runs.smoothed, smoothed_bound_rms)
    return summary


def _smoothed(runs: Runs, states: Runs, known: Array | None) -> Summary:
    """Return the section of smoothed states, with the RMS bound (K,), m, if it is known."""
    bound_rms = np.full(runs.time.shape, np.nan) if known is None else known
    error = states.horizontal_error
    settled = runs.elapsed > SETTLED_AFTER
    rms, bound, causal = _rms(error), _rms(bound_rms), _rms(runs.horizontal_error)
    return {
        "position_error": _position_error(error, settled),
        "nees_per_axis": _nees(nees_per_axis(states.error, states.covariance)),
        "bound": {"rms": bound, "rms_after_1h": _rms(bound_rms[settled])},
        "ratio": rms / bound if rms is not None and bound else None,
        "of_causal": rms / causal if rms is not None and causal else None,
        "rms_over_time": _rms_over_time(runs, bound_rms, smoothed=states.rms),
    }


def _position_error(error: Array, settled: Booleans) -> dict[str, Number]:
    return {
        "mean": _mean(error),
        "rms": _rms(error),
        "mean_after_1h": _mean(error[:, settled]),
        "rms_after_1h": _rms(error[:, settled]),
    }


def _nees(values: Array) -> Summary:
    mean, interval = mean_nees(values)
    return {"mean": finite(mean), "interval": [finite(end) for end in interval]}


def _fixes(runs: Runs) -> dict[str, int]:
    count = Counter(runs.fix_status.ravel().tolist())
    published = count[Status.FIX.value]
    return {
        "published": published,
        "declined": runs.fix_status.size - published,
        "failed": count[Status.FAILED.value],
        "rejected": count[Status.REJECTED.value],
    }


def _rms_over_time(runs: Runs, bound_rms: Array, **rms: Array) -> dict[str, list[Number]]:
    """Return RMS errors (K,) over runs, by name, and the bound over time."""
    step = float(np.median(np.diff(runs.time))) if runs.time.size > 1 else OVER_TIME_STEP
    entries = slice(None, None, max(1, round(OVER_TIME_STEP / step)))
    columns = {"time": runs.elapsed, **rms, "bound": bound_rms}
    return {
        name: [finite(value) for value in column[entries].tolist()]
        for name, column in columns.items()
    }


def diverged(runs: Runs) -> Booleans:
    """(R,) whether the mean horizontal error over the last `DIVERGENCE_WINDOW` is above
    `DIVERGENCE_LIMIT`, or not finite."""
    last = runs.time >= runs.time[-1] - DIVERGENCE_WINDOW
    return cast(Booleans, ~(runs.horizontal_error[:, last].mean(axis=1) <= DIVERGENCE_LIMIT))


def posterior_nees(runs: Runs) -> Array:
    """(R, B) NEES per axis of the navigator right after each published fix; NaN where a batch gave
    none."""
    return np.where(
        runs.published, nees_per_axis(runs.posterior_error, runs.posterior_covariance), np.nan
    )


def _mean(values: Array) -> Number:
    return finite(values.mean()) if values.size else None


def _rms(values: Array) -> Number:
    return finite(math.sqrt(np.mean(values**2))) if values.size else None


def _median(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else math.nan
