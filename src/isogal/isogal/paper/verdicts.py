"""Rules by which claims are decided, and the statistics they use."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from isogal.evaluation.html_report import number
from isogal.paper.measure import Outcome
from isogal.paper.results import Results

Verdict = Literal["holds", "does not hold", "cannot tell"]
HOLDS: Verdict = "holds"
FAILS: Verdict = "does not hold"
OPEN: Verdict = "cannot tell"
HOUR = 3600.0


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim, what was measured about it, and what follows."""

    key: str
    source: str
    text: str
    measured: str
    verdict: Verdict
    why: str
    """Where it does not hold or cannot be told: what the numbers say about the cause; may be
    empty."""


Decision = tuple[str, Verdict]
Decide = Callable[[Results], Decision]


@dataclass(frozen=True, slots=True)
class Entry:
    """How a claim is decided, and what is said about the cause where it does not hold."""

    key: str
    source: str
    text: str
    decide: Decide
    why: Callable[[Results], str] | None


REGISTER: list[Entry] = []


def claim(
    key: str, source: str, text: str, why: Callable[[Results], str] | None = None
) -> Callable[[Decide], Decide]:
    """Register a function that decides a claim."""

    def register(decide: Decide) -> Decide:
        REGISTER.append(Entry(key, source, text, decide, why))
        return decide

    return register


def decide(condition: bool, opposite: bool) -> Verdict:
    """Return the verdict of two exclusive findings; neither = cannot tell."""
    return HOLDS if condition else FAILS if opposite else OPEN


def paired(a: Outcome, b: Outcome) -> float:
    """Difference of the mean errors of the same runs over its standard error; 0 for a single
    run."""
    count = min(len(a.run_means), len(b.run_means))
    difference = a.run_means[:count] - b.run_means[:count]
    if count < 2 or not difference.any():
        return 0.0
    return float(difference.mean() / max(difference.std(ddof=1) / np.sqrt(count), 1e-12))


def rate_interval(count: int, total: int, confidence: float = 0.95) -> tuple[float, float]:
    """Exact interval of a share (Clopper and Pearson 1934)."""
    from scipy.stats import beta

    tail = (1.0 - confidence) / 2.0
    low = 0.0 if count == 0 else float(beta.ppf(tail, count, total - count + 1))
    high = 1.0 if count == total else float(beta.ppf(1.0 - tail, count + 1, total - count))
    return low, high


def quantum_gain(results: Results) -> tuple[float, float]:
    """Share by which quantum accelerometers reduce the unaided RMS error, and its standard error
    (jackknife over runs)."""
    precision, quantum = results.unaided("precision"), results.unaided("quantum_accelerometer")
    index = int(np.argmin(np.abs(precision.time - results.plan.gain_time)))
    a, b = precision.unaided[:, index] ** 2, quantum.unaided[:, index] ** 2
    gain = 1.0 - float(np.sqrt(b.mean() / a.mean()))
    if len(a) < 2:
        return gain, float("nan")
    left_out = 1.0 - np.sqrt((b.sum() - b) / (a.sum() - a))
    return gain, float(np.sqrt((len(a) - 1) * np.mean((left_out - left_out.mean()) ** 2)))


def benefit_time(outcome: Outcome) -> float:
    """Time (s) from which on the aided RMS error stays below the unaided one; NaN where it does
    not in the end."""
    worse = np.flatnonzero(outcome.rms >= outcome.unaided_rms)
    last = int(worse[-1]) if worse.size else -1
    return float(outcome.time[last + 1]) if last + 1 < len(outcome.time) else float("nan")


def metres(value: float) -> str:
    """Write a length."""
    return f"{number(value)} m"


def after(seconds: float) -> str:
    """Say when, for a time from the start."""
    if not np.isfinite(seconds):
        return "never"
    return "from the start" if seconds < 60.0 else f"after {seconds / HOUR:.1f} h"
