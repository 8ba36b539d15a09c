"""What a claim, its rule and its verdict are, and how measured values are worded."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from isogal.evaluation.html_report import number
from isogal.paper.results import Results

Verdict = Literal["holds", "does not hold", "cannot tell"]
HOLDS: Verdict = "holds"
FAILS: Verdict = "does not hold"
OPEN: Verdict = "cannot tell"
HOUR = 3600.0
"""s."""

Decision = tuple[str, Verdict]
"""What was measured, in words, and what follows."""


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim of the paper, what was measured about it, and the verdict."""

    key: str
    source: str
    """Where the paper makes it."""
    text: str
    measured: str
    verdict: Verdict
    why: str
    """Likely cause, where the claim does not hold or cannot be decided; may be empty."""


@dataclass(frozen=True, slots=True)
class Rule:
    """How a claim is decided, and what is said about the cause where it does not hold."""

    key: str
    source: str
    text: str
    decide: Callable[[Results], Decision]
    why: Callable[[Results], str] | None


def claim(
    key: str, source: str, text: str, why: Callable[[Results], str] | None = None
) -> Callable[[Callable[[Results], Decision]], Rule]:
    """Make the decorated function the rule by which a claim is decided."""

    def rule(decide: Callable[[Results], Decision]) -> Rule:
        return Rule(key, source, text, decide, why)

    return rule


def decide(condition: bool, opposite: bool) -> Verdict:
    """Return the verdict of two exclusive findings; neither = cannot tell."""
    return HOLDS if condition else FAILS if opposite else OPEN


def metres(value: float) -> str:
    """Write a length."""
    return f"{number(value)} m"


def after(seconds: float) -> str:
    """Write a time since the start; NaN = never."""
    if not np.isfinite(seconds):
        return "never"
    return "from the start" if seconds < 60.0 else f"after {seconds / HOUR:.1f} h"
