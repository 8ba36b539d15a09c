"""Chi-square distribution against scipy's."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from isogal.matching.chi_square import survival


@given(st.floats(0.5, 3000.0), st.floats(1e-3, 6.0))
def test_as_scipy(freedom: float, ratio: float) -> None:
    expected = float(chi2.sf(ratio * freedom, freedom))
    assert survival(ratio * freedom, freedom) == pytest.approx(expected, rel=1e-9, abs=1e-14)


def test_two_degrees_are_an_exponential() -> None:
    for value in (0.1, 1.0, 4.0, 50.0, 700.0):
        assert survival(value, 2.0) == pytest.approx(math.exp(-value / 2.0), rel=1e-12)


def test_ends() -> None:
    assert survival(0.0, 3.0) == survival(-1.0, 3.0) == 1.0
    assert survival(math.inf, 3.0) == survival(1e9, 3.0) == 0.0
    assert math.isnan(survival(math.nan, 3.0))
