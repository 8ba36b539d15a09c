"""`benchmarks/integrity.py`: the distribution of the errors."""

import integrity
import numpy as np
import pytest


def test_tails_are_found():
    """Of 40,000 values of a bivariate t of 20 degrees of freedom: the factor's sigma is 0.008, and
    that of 1 / freedom 0.003."""
    random = np.random.default_rng(2)
    squares = 1.2 * random.chisquare(2.0, 40_000) * 20.0 / random.chisquare(20.0, 40_000)
    factor, freedom = integrity.tails(squares)
    assert factor == pytest.approx(1.2, abs=0.03)
    assert 1.0 / freedom == pytest.approx(0.05, abs=0.012)
