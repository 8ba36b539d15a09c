"""Statistics by which claims are decided."""

import numpy as np

from isogal.paper.measure import Outcome
from isogal.paper.results import Results


def paired(a: Outcome, b: Outcome) -> float:
    """Difference of the mean errors of the same runs, in its standard errors; 0 for a single
    run."""
    count = min(len(a.run_means), len(b.run_means))
    difference = a.run_means[:count] - b.run_means[:count]
    if count < 2 or not difference.any():
        return 0.0
    return float(difference.mean() / max(difference.std(ddof=1) / np.sqrt(count), 1e-12))


def rate_interval(count: int, total: int, confidence: float = 0.95) -> tuple[float, float]:
    """Exact confidence interval of a share (Clopper and Pearson 1934)."""
    from scipy.stats import beta

    tail = (1.0 - confidence) / 2.0
    low = 0.0 if count == 0 else float(beta.ppf(tail, count, total - count + 1))
    high = 1.0 if count == total else float(beta.ppf(1.0 - tail, count + 1, total - count))
    return low, high


def quantum_gain(results: Results) -> tuple[float, float]:
    """Share by which quantum accelerometers reduce the unaided RMS error, and its standard error
    (jackknife over runs; NaN for a single run)."""
    precision, quantum = results.unaided("precision"), results.unaided("quantum_accelerometer")
    index = int(np.argmin(np.abs(precision.time - results.plan.gain_time)))
    a, b = precision.unaided[:, index] ** 2, quantum.unaided[:, index] ** 2
    gain = 1.0 - float(np.sqrt(b.mean() / a.mean()))
    if len(a) < 2:
        return gain, float("nan")
    left_out = 1.0 - np.sqrt((b.sum() - b) / (a.sum() - a))
    return gain, float(np.sqrt((len(a) - 1) * np.mean((left_out - left_out.mean()) ** 2)))


def benefit_time(outcome: Outcome) -> float:
    """Time (s) from which on the aided RMS error stays below the unaided one; NaN if it never
    does."""
    worse = np.flatnonzero(outcome.rms >= outcome.unaided_rms)
    last = int(worse[-1]) if worse.size else -1
    return float(outcome.time[last + 1]) if last + 1 < len(outcome.time) else float("nan")
