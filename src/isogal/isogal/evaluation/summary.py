"""The figures of merit of a set of runs, in the format of `results.json` and `summary.json`."""

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any, cast

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.evaluation.consistency import mean_nees, nees_per_axis
from isogal.evaluation.integrity import integrity
from isogal.evaluation.judgement import SETTLED_AFTER, all_scans_nees, judge
from isogal.evaluation.records import Runs
from isogal.files import write_atomic
from isogal.fix import Status
from isogal.scenario import Scenario

DIVERGENCE_LIMIT = 2000.0
"""m; a run whose mean error over its last part is above this has diverged (about twice that of the
unaided INS there; docs/mathematics.md, section 11.4)."""
DIVERGENCE_WINDOW = 1800.0
"""s, length of that last part."""
OVER_TIME_STEP = 60.0
"""s between the entries of rms_over_time."""


def summarise(
    runs: Runs,
    scenario: Scenario,
    bound_rms: Array,
    *,
    wall_seconds: float = math.nan,
) -> dict[str, Any]:
    """Figures of merit of the runs, plain JSON numbers (None where there is none).

    Parameters
    ----------
    runs : Runs
        At least one run.
    scenario : Scenario
        What they were runs of.
    bound_rms : (K,) array
        m, RMS bound at `runs.time` (`BoundResult.rms_at`); NaN where not known.
    wall_seconds : float
        Wall time that the runs took; NaN = not measured.

    Returns
    -------
    dict
        Keys `scenario`, `matcher`, `runs`, `diverged` (count), `position_error` (horizontal, m:
        mean and RMS over time and runs, both also after the first hour), `unaided`, `bound`,
        `nees_per_axis` (navigator right after the published fixes; chi-square interval for as
        many independent values as they are worth; docs/mathematics.md, section 11.3),
        `nees_all_scans` (at every recorded state but the start), `judgement` (of runs that let
        their user down), `integrity` (protection level), `fixes`, `time`, `rms_over_time`.

    Raises
    ------
    ValueError
        Without runs, or where `bound_rms` has another shape than `runs.time`.
    """
    if len(runs) == 0:
        raise ValueError("no runs to summarise")
    if bound_rms.shape != runs.time.shape:
        raise ValueError(f"bound_rms must have shape {runs.time.shape}, has {bound_rms.shape}")
    aided, unaided = runs.horizontal_error, runs.unaided_horizontal_error
    settled, astray = runs.elapsed > SETTLED_AFTER, diverged(runs)
    result = {
        "scenario": scenario.model_dump(mode="json"),
        "matcher": scenario.matcher.name,
        "runs": len(runs),
        "diverged": int(astray.sum()),
        "position_error": {
            "mean": _mean(aided),
            "rms": _rms(aided),
            "mean_after_1h": _mean(aided[:, settled]),
            "rms_after_1h": _rms(aided[:, settled]),
        },
        "unaided": {"mean": _mean(unaided), "rms": _rms(unaided)},
        "bound": {"rms": _rms(bound_rms), "rms_after_1h": _rms(bound_rms[settled])},
        **_consistency(runs, astray, scenario),
        "fixes": _fixes(runs),
        "time": {"wall_s": wall_seconds, "fix_ms_median": _median(runs.fix_seconds) * 1e3},
        "rms_over_time": _rms_over_time(runs, bound_rms),
    }
    return cast(dict[str, Any], plain(result))


def _consistency(runs: Runs, astray: Booleans, scenario: Scenario) -> dict[str, Any]:
    after_fixes, all_scans = mean_nees(posterior_nees(runs)), mean_nees(all_scans_nees(runs))
    return {
        "nees_per_axis": {"mean": after_fixes.mean, "interval": list(after_fixes.interval)},
        "nees_all_scans": {"mean": all_scans.mean, "interval": list(all_scans.interval)},
        "judgement": judge(runs, astray).as_json(),
        "integrity": integrity(runs, scenario.integrity),
    }


def _fixes(runs: Runs) -> dict[str, int]:
    """Return how many batches gave a fix and how many did not; on how many of these the matcher
    has failed or the navigator rejected the fix."""
    count = Counter(runs.fix_status.ravel().tolist())
    published = count[Status.FIX.value]
    return {
        "published": published,
        "declined": runs.fix_status.size - published,
        "failed": count[Status.FAILED.value],
        "rejected": count[Status.REJECTED.value],
    }


def _rms_over_time(runs: Runs, bound_rms: Array) -> dict[str, Array]:
    step = float(np.median(np.diff(runs.time))) if runs.time.size > 1 else OVER_TIME_STEP
    entries = slice(None, None, max(1, round(OVER_TIME_STEP / step)))
    aided, unaided = runs.horizontal_error[:, entries], runs.unaided_horizontal_error[:, entries]
    return {
        "time": runs.elapsed[entries],
        "aided": np.sqrt(np.mean(aided**2, axis=0)),
        "unaided": np.sqrt(np.mean(unaided**2, axis=0)),
        "bound": bound_rms[entries],
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


def plain(value: Any) -> Any:
    """Convert arrays, NumPy scalars and tuples to the types of JSON; a number that is not finite
    becomes None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def canonical_json(value: Any) -> str:
    """Format a document so that equal content gives equal bytes: order of keys as given, two
    spaces, lists of numbers in a line."""
    return _format(plain(value), "") + "\n"


def write_json(path: str | Path, value: Any) -> None:
    """Write `canonical_json` of the value; the file appears whole or not at all."""
    write_atomic(path, canonical_json(value))


def _format(value: Any, indent: str) -> str:
    inner = indent + "  "
    if isinstance(value, dict) and value:
        items = (
            f"{inner}{json.dumps(key, ensure_ascii=False)}: {_format(item, inner)}"
            for key, item in value.items()
        )
        return "{\n" + ",\n".join(items) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        return "[\n" + ",\n".join(inner + _format(item, inner) for item in value) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _mean(values: Array) -> float:
    return float(values.mean()) if values.size else math.nan


def _rms(values: Array) -> float:
    return math.sqrt(float(np.mean(values**2))) if values.size else math.nan


def _median(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else math.nan
