"""The innovation gate: a measurement that cannot be right changes nothing (docs/mathematics.md,
section 3.13)."""

import math
from functools import cache

REJECTED = "rejected by the navigator: "
"""Begins the reason of a batch whose fix is beyond the gate."""


def beyond(nis: float, allowed: float) -> str:
    """Say by how much a measurement is beyond the gate."""
    return f"normalised innovation squared {nis:.1f}, allowed {allowed:.1f}"


@cache
def quantile(probability: float, dimensions: int) -> float:
    """Return what chi-square of so many dimensions exceeds with a probability; infinity for 0.

    By bisection of its closed form: SciPy's takes longer to import than a filter to start."""
    if probability <= 0.0:
        return math.inf
    low, high = 0.0, 1.0
    while _exceeded(high, dimensions) > probability:
        high *= 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = _exceeded(middle, dimensions) > probability
        low, high = (middle, high) if above else (low, middle)
    return high


def _exceeded(x: float, dimensions: int) -> float:
    """Return how probable it is that chi-square exceeds x: Q(a + 1, h) = Q(a, h) + h^a exp(-h) /
    Gamma(a + 1), h = x / 2, from Q(1/2, h) = erfc(sqrt(h)) or Q(1, h) = exp(-h) on."""
    half, odd = 0.5 * x, dimensions % 2
    total = math.erfc(math.sqrt(half)) if odd else math.exp(-half)
    first = 0.5 if odd else 1.0
    for k in range((dimensions - 1) // 2):
        a = first + k
        total += half**a * math.exp(-half) / math.gamma(a + 1.0)
    return total
