"""The innovation gate: a measurement that cannot be right changes nothing (docs/mathematics.md,
section 3.13)."""

import math

from scipy.special import chdtri

REJECTED = "rejected by the navigator: "
"""Begins the reason of a batch whose fix is beyond the gate."""


def quantile(probability: float, dimensions: int) -> float:
    """Return what chi-square of so many dimensions exceeds with a probability; infinity for 0."""
    return float(chdtri(dimensions, probability)) if probability > 0.0 else math.inf
