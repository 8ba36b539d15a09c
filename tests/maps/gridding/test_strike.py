"""The strike of each place of a survey."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.surveys import drawn, few_places, flight_lines, survey_at
from isogal.maps.gridding.covariance import Covariance, Readings
from isogal.maps.gridding.gridder import LOCAL, GridSettings, learn_model
from isogal.maps.gridding.strike import local_strike, with_local_strike

__all__ = ["few_places"]

PARTS = (3.0, 2.0), (1500.0, 4000.0)


def of_log(shape):
    """Strike of places all over a square of 20 km, (C, 2) elements of log S."""
    centre = np.random.default_rng(1).uniform(-1e4, 1e4, (len(shape), 2))
    return local_strike(centre, np.asarray(shape), 2e3)


@given(
    st.lists(st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)), min_size=12, max_size=12),
    st.integers(0, 1000),
)
def test_covariance_of_any_strikes_is_one(shape, seed):
    covariance = Covariance("matern", *PARTS, noise=0.0, local=of_log(shape))
    places = np.random.default_rng(seed).uniform(-1.2e4, 1.2e4, (60, 3))
    among = covariance.between(places, places)
    assert np.linalg.eigvalsh(among).min() > -1e-9 * covariance.variance
    np.testing.assert_allclose(np.diag(among), covariance.variance)


@pytest.fixture(scope="module")
def two_strikes():
    """Lines to the east, 2 km apart, over a field that strikes north-east in the west and
    north-west in the east: readings, and numbers of lines."""
    places, line = flight_lines(11, 2000.0, 500.0, 14e3)
    weight = 0.5 * (1.0 + np.tanh(places[:, 0] / 3e3))
    value = np.zeros(len(places))
    for seed, share, turn in ((3, 1.0 - weight, 1.0), (4, weight, -1.0)):
        along = (places[:, 0] + turn * places[:, 1]) / math.sqrt(2.0)
        across = (places[:, 0] - turn * places[:, 1]) / math.sqrt(2.0)
        stretched = np.stack([along / 5.0, across], axis=1)
        value += np.sqrt(share) * drawn(stretched, seed, length=2500.0)[1]
    return places, line, value


def test_strikes_are_found(two_strikes):
    places, line, value = two_strikes
    covariance = Covariance("matern", (7e-5, 7e-5), (2500.0, 5000.0), noise=2e-6)
    readings = Readings(np.column_stack([places, 0.0 * line]), value, line=line)
    found = with_local_strike(readings, covariance, 2000.0).covariance.local
    for east, strike in ((-9e3, 45.0), (9e3, -45.0)):
        at = np.array(
            [[east + x, y, 0.0] for x in (-3e3, 0.0, 3e3) for y in 1e3 * np.arange(-8, 9)]
        )
        nn, en, ee = found(at).T
        np.testing.assert_allclose(ee * nn - en**2, 1.0, rtol=1e-9)
        # of a few anomalies
        mean = 0.5 * np.degrees(np.arctan2(2.0 * en.mean(), (ee - nn).mean()))
        assert mean == pytest.approx(strike, abs=20.0)


def test_it_is_taken_where_lines_left_out_are_predicted_better(two_strikes):
    places, line, value = two_strikes
    survey = survey_at(places, value, line=line)
    report = learn_model(survey, GridSettings("kriging", block=0.0)).report
    off = report["mean_absolute_error"]
    assert report["method"] == LOCAL and off[LOCAL] < 0.95 * off["kriging"]
    assert 0.7 < report["left_out"]["nis"] < 1.3
