"""Data as they should not be: the matcher declines with one line, or does without, and goes on
with the next batch."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch, wavy
from isogal.matching.pmht.matcher import Pmht
from isogal.matching.registry import build_matcher
from isogal.scenario import Matcher

ERROR = np.array([250.0, -300.0, 0.03, 0.02])


def blank(batch, keep):
    return replace(
        batch, reading=np.where(np.isin(np.arange(len(batch)), keep), batch.reading, np.nan)
    )


def with_prior(batch, prior):
    return replace(batch, prior=prior)


def put(batch, name, index, value):
    array = getattr(batch, name).copy()
    array[index] = value
    return replace(batch, **{name: array})


LOPSIDED = np.diag([1e4, 1e4, 1e-2, 1e-2])
LOPSIDED[0, 1] = LOPSIDED[1, 0] = 2e4

DECLINED = {
    "no reading": lambda b: blank(b, []),
    "two readings": lambda b: blank(b, [3, 20]),
    "off the map": lambda b: replace(b, latitude=b.latitude + 0.1),
    "zero prior": lambda b: with_prior(b, np.zeros((4, 4))),
    "prior not definite": lambda b: with_prior(b, LOPSIDED),
    "prior not finite": lambda b: with_prior(b, np.full((4, 4), np.nan)),
    "position not finite": lambda b: put(b, "latitude", 7, np.nan),
    "velocity not finite": lambda b: put(b, "velocity", 7, np.inf),
    "transition not finite": lambda b: put(b, "transition", 7, np.nan),
    "jacobian not finite": lambda b: put(b, "reading_jacobian", 7, np.nan),
    "drift not finite": lambda b: replace(
        b, nuisance_position=np.full((30, 2, 3), np.nan), nuisance_reading=np.zeros((30, 3))
    ),
    "sigma zero": lambda b: put(b, "sigma", 7, 0.0),
    "sigma not finite": lambda b: put(b, "sigma", 7, np.nan),
    "time runs back": lambda b: put(b, "time", 7, 0.0),
    "readings of another world": lambda b: replace(
        b, reading=b.reading + 1e-2 * np.random.default_rng(1).standard_normal(30)
    ),
    "huge readings": lambda b: replace(b, reading=b.reading * 1e200),
}

FEW_SUFFICE = ("two readings",)
PAPER_TRUSTS = ("readings of another world", "huge readings")
"""The paper's algorithm takes the nearest values of the map, however far they are from the
readings."""


@pytest.mark.parametrize("name", ["pmht", "pmht-paper"])
@pytest.mark.parametrize("what", DECLINED)
def test_it_declines_with_one_line_and_goes_on(rough_map, name, what):
    matcher = build_matcher(Matcher(name=name))
    batch, _ = make_batch(rough_map, ERROR)
    odd = DECLINED[what](batch)
    fix, memory = matcher.match(odd, rough_map, None)
    trusted = PAPER_TRUSTS if name == "pmht-paper" else FEW_SUFFICE
    assert not fix.published or what in trusted
    if not fix.published:
        assert fix.reason
        assert "\n" not in fix.reason
        assert np.isnan(fix.covariance).all()
        assert fix.information is None
    later = replace(batch, time=batch.time + 300.0)
    after, memory = matcher.match(later, rough_map, memory)
    assert after.published, after.reason
    _, memory = matcher.match(replace(odd, time=odd.time + 600.0), rough_map, memory)
    assert matcher.match(replace(batch, time=batch.time + 900.0), rough_map, memory)[0].published


@pytest.mark.parametrize("keep", [range(0, 30, 2), range(20), [5, 9, 14, 22, 29]])
def test_missing_readings_are_done_without(rough_map, keep):
    batch, truth = make_batch(rough_map, ERROR)
    fix, _ = Pmht.from_settings(Matcher()).match(blank(batch, list(keep)), rough_map, None)
    if fix.published:
        error = truth.error_of(fix)
        assert error @ np.linalg.solve(fix.covariance, error) < 20.0
    else:
        assert fix.reason.startswith("ambiguous")
        assert len(keep) < 10


def test_a_hole_in_the_map_where_the_navigator_may_be(rough_map):
    """Half the prior lies in a hole: what the map covers is searched, and the true place is in
    it."""
    batch, truth = make_batch(rough_map, ERROR, start=(-3000.0, -3000.0))
    values = rough_map.values.copy()
    values[:, : values.shape[1] // 2 - 20] = np.nan  # all that is further than 5 km to the west
    fix, _ = Pmht.from_settings(Matcher()).match(batch, replace(rough_map, values=values), None)
    assert fix.published
    error = truth.error_of(fix)
    assert error @ np.linalg.solve(fix.covariance, error) < 20.0


def test_a_flat_map_tells_nothing():
    flat = field_map_of(lambda north, east: 0.0 * north + 0.0 * east, step=2000.0)
    batch, _ = make_batch(flat, ERROR)
    fix, memory = Pmht.from_settings(Matcher()).match(batch, flat, None)
    assert not fix.published
    assert fix.reason == "the batch tells nothing that the navigator does not know"
    assert memory.hypotheses is None


def test_a_certain_navigator_learns_nothing(rough_map):
    batch, _ = make_batch(rough_map, np.zeros(4), prior_sigma=(1e-3, 1e-7))
    fix, _ = Pmht.from_settings(Matcher()).match(batch, rough_map, None)
    assert not fix.published
    assert fix.reason == "the batch tells nothing that the navigator does not know"


def test_more_noise_than_assumed_is_noticed_and_owned_up_to(rough_map):
    """Readings three times noisier than their sigma says: fixes stay honest, as the matcher widens
    its noise."""
    matcher, memory = Pmht.from_settings(Matcher(map_sigma=0.0)), None
    squares, factors = [], []
    for number in range(25):
        random = np.random.default_rng(number)
        error = random.standard_normal(4) * [200.0, 200.0, 0.05, 0.05]
        start = random.uniform(-15e3, 8e3, 2)
        time = 1000.0 + 300.0 * number + 10.0 * np.arange(30)
        batch, _ = make_batch(
            rough_map,
            error,
            start=start,
            prior_sigma=(200.0, 0.05),
            seed=number,
            sigma=3e-5,
            time=time,
        )
        batch = replace(batch, sigma=np.full(30, 1e-5))
        fix, memory = matcher.match(batch, rough_map, memory)
        factors.append(memory.variance_factor.value)
        if fix.published and number > 8:
            covariance = np.linalg.inv(np.linalg.inv(batch.prior) + fix.information.matrix)
            apart = error - covariance @ fix.information.vector
            squares.append(apart @ np.linalg.solve(covariance, apart) / 4.0)
    assert factors[-1] == pytest.approx(9.0, rel=0.35)
    assert len(squares) > 8
    assert np.mean(squares) < 2.0  # 9 if it believed the sigma


def test_estimated_map_error_makes_fixes_honest():
    """map_sigma auto on a map that is wrong by twice the sensor's noise and more."""
    field_map = field_map_of(wavy)
    matcher, memory = Pmht.from_settings(Matcher(map_sigma="auto")), None
    squares = []
    for number in range(25):
        random = np.random.default_rng(number)
        error = random.standard_normal(4) * [200.0, 200.0, 0.05, 0.05]
        start = random.uniform(-15e3, 8e3, 2)
        time = 1000.0 + 300.0 * number + 10.0 * np.arange(30)
        batch, _ = make_batch(
            field_map, error, start=start, prior_sigma=(200.0, 0.05), seed=number, time=time
        )
        away = 220.0 * np.abs(np.arange(30)[:, None] - np.arange(30))
        root = np.linalg.cholesky(np.exp(-away / 3000.0))
        batch = replace(batch, reading=batch.reading + 4e-5 * root @ random.standard_normal(30))
        fix, memory = matcher.match(batch, field_map, memory)
        if fix.published and number > 4:
            covariance = np.linalg.inv(np.linalg.inv(batch.prior) + fix.information.matrix)
            apart = error - covariance @ fix.information.vector
            squares.append(apart @ np.linalg.solve(covariance, apart) / 4.0)
    assert fix.diagnostics["map_sigma"] == pytest.approx(4e-5, rel=0.4)
    assert len(squares) > 15
    assert 0.5 < np.mean(squares) < 1.6
