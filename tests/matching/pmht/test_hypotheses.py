"""The bank: what splits, merges and updates keep."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from helpers.bank import HERE, PLANE, SLOPE, models, moments_of, random_bank, states_of
from helpers.batches import field_map_of, make_batch, wavy
from helpers.navigators import random_covariance
from isogal.earth.ellipsoid import metres_per_radian
from isogal.matching.information import LARGEST_RATIO
from isogal.matching.interfaces import Information
from isogal.matching.pmht import hypotheses as bank_of
from isogal.matching.pmht.hypotheses import (
    CREDIBLE,
    FAINT,
    FLOOR,
    LIGHT,
    MOST,
    NEGLIGIBLE,
    Hypotheses,
    with_needed,
)
from isogal.matching.pmht.memory import steps
from isogal.matching.pmht.models import BIASED, DECEIVED, LATE, NONE, Models
from isogal.matching.pmht.rows import rows_of
from isogal.matching.pmht.search import resolved, spread_over
from isogal.matching.pmht.states import DELAY, UNKNOWN
from isogal.passage import Aided

ROUGH = field_map_of(wavy)
SIGMA = np.array([300.0, 200.0, 0.3, 0.2, 5e-5, 5e-5, 5e-4])
EXACT = models(sigma=0.0, trust=1.0)
TO_THE_LETTER = models(sigma=1e-5, trust=1.0)
seeds = st.integers(0, 2**32 - 1)


def same(a, b, within=1e-9):
    scale = np.sqrt(np.diag(b[1]))
    np.testing.assert_allclose(a[0] / scale, b[0] / scale, atol=within)
    np.testing.assert_allclose(
        a[1] / scale / scale[:, None], b[1] / scale / scale[:, None], atol=within
    )


def rows(field_map=ROUGH, scans=15, which=EXACT, **keys):
    batch, _ = make_batch(field_map, scans=scans, **keys)
    return rows_of(batch, field_map, states_of(), which.lengths, None)[0]


@given(seeds)
def test_a_split_conserves_weight_mean_and_covariance(seed):
    bank = random_bank(seed, 3)
    direction = np.random.default_rng(seed).standard_normal((3, 2))
    roots = np.linalg.cholesky(bank.covariance[:, :2, :2])  # to 1-sigma vectors
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    direction = np.einsum("kij,kj->ki", roots, direction)
    # how all states move with the place, by regression
    solved = np.linalg.solve(bank.covariance[:, :2, :2], direction[..., None])
    along = (bank.covariance[:, :, :2] @ solved)[..., 0]
    parts = bank._thirds(along)
    assert len(parts) == 9
    assert parts.log_evidence == pytest.approx(bank.log_evidence, abs=1e-8)
    for k in range(3):
        one = bank.part(np.array([k]))
        three = parts.part(np.array([k, 3 + k, 6 + k]))
        same(moments_of(three), moments_of(one), 1e-6)  # the weights have ten digits
        assert (np.linalg.eigvalsh(three.covariance / one.covariance.max()) > -1e-9).all()
        narrower = direction[k] @ np.linalg.solve(three.covariance[0, :2, :2], direction[k])
        assert narrower == pytest.approx(1.0 / bank_of.SPLIT[2] ** 2)


def test_places_are_split_until_the_map_is_nearly_linear():
    prior = np.diag(np.square([400.0, 300.0, 0.01, 0.01, 1e-8, 1e-8, 1e-8]))
    bank = Hypotheses.before(EXACT, prior)
    on_plane = bank.split(PLANE, rows(PLANE))
    assert on_plane is bank
    parts = bank.split(ROUGH, rows())
    assert len(parts) > 9
    assert parts.log_evidence == pytest.approx(0.0, abs=1e-6)
    same(parts.moments(), (np.zeros(7), prior), 1e-6)
    assert np.median(np.sqrt(parts.covariance[:, 0, 0])) < 250.0
    assert len(bank.split(ROUGH, rows(), curved=0.08)) > len(parts)


def test_the_map_error_is_that_of_the_place_of_a_hypothesis():
    said = models(sigma=1e-5, trust=1.0)
    north = np.arange(61)[:, None] * np.ones(61)
    worse = replace(PLANE, sigma=1e-5 * (1.0 + north / 10.0), error_stated=True)
    off = 6000.0
    place = np.array([off, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    batch, _ = make_batch(worse, scans=5, seed=None)
    metres = metres_per_radian(batch.latitude[0])[0]
    away = replace(batch, latitude=batch.latitude + off / metres)
    bank = Hypotheses.before(said, np.diag(np.square([10.0, 10.0, 0.01, 0.01, 1e-8, 1e-8, 1e-8])))
    evidence = []
    for one, at in ((batch, 0.0 * place), (away, place)):
        new = rows_of(one, worse, states_of(), said.lengths, None)[0]
        evidence.append(bank.moved(-at).observed(worse, new).log_evidence)
    assert evidence[1] == pytest.approx(evidence[0], abs=1e-3)


@pytest.mark.parametrize("off", [0.0, 1.0, 30.0])
def test_evidence_of_errors_with_tails_is_students_t(off):
    said, plain = models(sigma=0.0, trust=1.0, tails=4.0), EXACT
    prior = np.diag(np.square([10.0, 10.0, 0.01, 0.01, 1e-8, 1e-8, 1e-8]))
    batch, _ = make_batch(PLANE, scans=1, seed=None)
    batch = replace(batch, reading=batch.reading + off * 1e-5)
    new = rows_of(batch, PLANE, states_of(), said.lengths, None)[0]
    found, gaussian = (
        Hypotheses.before(which, prior).observed(PLANE, new) for which in (said, plain)
    )
    scale = math.sqrt(new.noise[0] + SLOPE @ prior[:2, :2] @ SLOPE)
    expected = stats.t.logpdf(off * 1e-5, df=4.0, scale=scale)
    assert found.log_evidence == pytest.approx(expected, abs=1e-4)
    # what is far off moves it less, and tells less: by the density's curvature
    square = (off * 1e-5 / scale) ** 2
    share = min(1.0, 5.0 / (4.0 + square))
    curvature = min(1.0, 5.0 * (4.0 - square) / (4.0 + square) ** 2)
    told, fully = (prior[:2, :2] - one.covariance[0, :2, :2] for one in (found, gaussian))
    np.testing.assert_allclose(told, curvature * fully, rtol=1e-3, atol=1e-3)
    if off < 3.0:
        np.testing.assert_allclose(found.mean[0, :2], share * gaussian.mean[0, :2], rtol=1e-6)
    else:
        assert np.abs(found.mean[0, :2]).max() < 0.01 * off


def test_there_are_never_more_than_so_many():
    prior = np.diag(np.square([4000.0, 4000.0, 0.01, 0.01, 1e-8, 1e-8, 1e-8]))
    parts = Hypotheses.before(models(), prior).split(ROUGH, rows(which=models()))
    assert 1000 < len(parts) <= MOST
    assert len(parts.reduced(HERE)) <= MOST


@given(seeds)
def test_being_informed_is_a_gaussian_update(seed):
    bank, random = random_bank(seed, 4), np.random.default_rng(seed)
    root = random.standard_normal((5, 7)) / SIGMA
    matrix, vector = root.T @ root, root.T @ random.standard_normal(5)
    after = bank.informed(Information(vector, matrix), np.diag(SIGMA**2))
    H = np.zeros((7, bank.mean.shape[1]))
    H[:, :7] = np.eye(7)
    for k in range(len(bank)):
        precision = np.linalg.inv(bank.covariance[k]) + H.T @ matrix @ H
        covariance = np.linalg.inv(precision)
        mean = covariance @ (np.linalg.solve(bank.covariance[k], bank.mean[k]) + H.T @ vector)
        same((after.mean[k], after.covariance[k]), (mean, covariance), 1e-5)
        # evidence: the integral of exp(vector' x - x' matrix x / 2) over the prior
        P, m = bank.covariance[k, :7, :7], bank.mean[k, :7]
        inverse = np.linalg.inv(P)
        b = inverse @ m + vector
        log = 0.5 * b @ np.linalg.solve(inverse + matrix, b) - 0.5 * m @ inverse @ m
        log -= 0.5 * np.linalg.slogdet(np.eye(7) + P @ matrix)[1]
        assert after.log_weight[k] - bank.log_weight[k] == pytest.approx(log, rel=1e-5, abs=1e-5)


def carried(bank, *change):
    forward, growth, learnt = steps(*change)
    return bank.carried(learnt @ forward, learnt @ growth @ learnt.T)


@given(seeds)
def test_growth_of_the_navigator_joins_each_and_what_it_learnt_narrows_each(seed):
    before = random_covariance(SIGMA, seed)
    forward = np.eye(7) + np.diag([60.0, 60.0, 0.0, 0.0, 0.0], 2)
    back = np.linalg.inv(forward)
    random = np.random.default_rng(seed)
    root = random.standard_normal((7, 7)) * SIGMA[:, None] * 0.3
    prior = forward @ before @ forward.T + root @ root.T
    bank = carried(Hypotheses.before(EXACT, before), before, back, prior)
    same(bank.moments(), (np.zeros(7), prior), 1e-7)
    learnt = forward @ before @ forward.T
    gain = learnt[:, :1] / (learnt[0, 0] + 50.0**2)
    told = learnt - gain @ learnt[:1]  # an aid has measured one position
    bank = carried(Hypotheses.before(EXACT, before), before, back, told)
    same(bank.moments(), (np.zeros(7), told), 1e-5)


def test_a_worse_navigator_grows_by_its_factor():
    which = models()
    before = np.diag(SIGMA**2)
    bank = carried(Hypotheses.before(which, before), before, np.eye(7), 2.0 * before)
    expected = (which.start + which.growth)[:, None] * np.diag(before)
    np.testing.assert_allclose(bank.covariance[:, range(7), range(7)], expected)


def test_reduced_keeps_moments_of_what_overlaps_and_every_group():
    which = models()
    bank = random_bank(1, 4, TO_THE_LETTER)
    bank.mean[:, :2] *= 0.01  # one place
    same(moments_of(bank.reduced(HERE)), moments_of(bank), 1e-9)
    bank = Hypotheses.before(which, np.diag(SIGMA**2))
    bank = replace(bank, log_weight=np.where(which.family == BIASED, 0.0, -500.0))
    after = bank.reduced(HERE)
    assert set(after.which) == set(range(len(which.sigma)))
    assert after.log_evidence == pytest.approx(0.0)
    np.testing.assert_allclose(after.log_weight.max() - after.log_weight.min(), FLOOR)


def test_light_models_have_one_place_and_negligible_ones_go():
    which = models(sigma=3e-5)
    bank = random_bank(2, 6, Models._make(column[:2] for column in which))
    bank.which[:] = [0, 0, 0, 1, 1, 1]
    bank.mean[:, 0] = [0.0, 1e5, 2e5, 0.0, 1e5, 2e5]
    bank.log_weight[:] = [0.0, -3.0, -30.0, -LIGHT - 1.0, -LIGHT - 1.5, -LIGHT - 2.0]
    after = bank.reduced(HERE)
    assert list(after.which) == [0, 0, 1]


def test_models_that_are_negligible_beside_their_neighbours_are_left_out():
    """And come back with what a neighbour knows, in units of their own sigma."""
    which = models()
    group = np.flatnonzero(which.group == 0)
    assert (np.diff(which.sigma[group]) > 0.0).all()
    which = Models._make(column[group] for column in which)
    bank = Hypotheses.before(which, np.diag(SIGMA**2))
    best = len(group) // 2
    steep = replace(bank, log_weight=-6.0 * np.abs(np.arange(len(group)) - best))
    left = with_needed(steep, 1)
    assert set(left.which) == set(range(best - 2, best + 3))  # those within 10, and one on
    last = best + 2
    left.mean[left.which == last, 7] = 0.5
    up = replace(left, log_weight=np.where(left.which == last, 0.0, -30.0))
    up = with_needed(up, 1)
    assert set(up.which) == {last - 1, last, last + 1}
    new = up.which == last + 1
    ratio = which.sigma[last] / which.sigma[last + 1]
    np.testing.assert_allclose(up.mean[new, 7], 0.5 * ratio)
    np.testing.assert_allclose(
        up.covariance[new, 7, 7], ratio**2 * left.covariance[left.which == last, 7, 7]
    )
    prior = which.log_prior[last + 1] - which.log_prior[last]
    assert up.log_weight[new] - up.log_weight[up.which == last] == pytest.approx(prior)


def test_a_negligible_neighbour_of_a_smaller_sigma_takes_the_places_of_the_larger():
    """Its own are those that made it negligible: with them it would never be probable again. One
    of a larger sigma keeps its own."""
    which = models()
    group = np.flatnonzero(which.group == 0)[:3]
    which = Models._make(column[group] for column in which)
    bank = Hypotheses.before(which, np.diag(SIGMA**2))
    bank.mean[:, 0] = [9000.0, 30.0, -9000.0]
    after = with_needed(replace(bank, log_weight=np.array([-40.0, 0.0, -50.0])), 1)
    after = after.part(np.argsort(after.which))
    np.testing.assert_array_equal(after.mean[:, 0], [30.0, 30.0, -9000.0])
    prior = which.log_prior[0] - which.log_prior[1]
    assert after.log_weight[0] - after.log_weight[1] == pytest.approx(prior - NEGLIGIBLE)
    assert after.log_weight[2] == -50.0


def test_a_model_without_an_error_of_the_map_gives_its_neighbour_an_unknown_one():
    which = models()
    own = which.group == which.group[np.argmin(which.sigma)]
    which = Models._make(column[own][:2] for column in which)._replace(group=np.zeros(2, int))
    bank = Hypotheses.before(which, np.diag(SIGMA**2)).part(np.array([0]))
    after = with_needed(bank, 1)
    assert which.sigma[0] == 0.0 < which.sigma[1]
    np.testing.assert_allclose(after.covariance[after.which == 1, 7, 7], 1.0)
    back = with_needed(after.part(after.which == 1), 1)
    assert (back.covariance[back.which == 0, 7] == 0.0).all()


def test_places_of_a_late_model_are_split_along_the_way():
    """A delay of 20 s is 1.3 km along the track, which a position known to 50 m does not show."""
    late = models()
    late = Models._make(column[late.family == LATE][:1] for column in late)
    late = late._replace(shape=np.zeros_like(late.shape))  # the only shape of its rows
    prior = np.diag(np.square([50.0, 50.0, 0.01, 0.01, 1e-8, 1e-8, 1e-8]))
    bank = Hypotheses.before(late, prior)
    new = rows(which=late, scans=30, velocity=(40.0, 50.0))
    parts = bank.split(ROUGH, new)
    assert len(parts) > 3
    same(parts.moments(), bank.moments(), 1e-6)
    delay = parts.mean[:, DELAY - len(UNKNOWN)]
    assert np.ptp(delay) > 20.0  # and not of one position only
    assert len(parts.reduced(new.place[-1])) > 3  # nor are they one place again


def test_models_that_are_likely_in_their_group_keep_their_places():
    """What is improbable at first, as a delay, may be right: it must not have lost its place, nor
    the evidence of all its places."""
    which = models()
    late = np.flatnonzero(which.family == LATE)[:3]
    four = np.r_[np.flatnonzero(which.family == NONE)[:1], late]
    none, best, near, far = range(4)
    bank = random_bank(2, 12, Models._make(column[four] for column in which))
    bank.which[:] = np.repeat([none, best, near, far], 3)
    bank.mean[:, 0] = np.tile([0.0, 1e5, 2e5], 4)
    apart = np.array([0.0, -0.5, -FAINT - 0.5])
    bank.log_weight[:] = np.concatenate([
        [0.0, -3.0, -30.0],
        -LIGHT - 4.0 + apart, -LIGHT - 4.5 + apart, -2.0 * LIGHT - 4.5 + apart,
    ])  # fmt: skip
    after = bank.reduced(HERE)
    assert list(np.sort(after.which)) == [none, none, best, best, near, near, far]


@pytest.mark.parametrize(("away", "sigma", "known"), [
    (200.0, 50.0, True), (3000.0, 50.0, False), (0.0, 900.0, False),
])  # fmt: skip
def test_a_place_is_known_where_all_that_is_probable_is_near(away, sigma, known):
    bank = random_bank(5, 2, EXACT)
    bank.mean[:, :2] = [[0.0, 0.0], [away, 0.0]]
    bank.covariance[:, :2, :2] = sigma**2 * np.eye(2)
    bank.log_weight[:] = [-0.7, -0.7]
    assert resolved(bank) is known
    unlikely = replace(bank, log_weight=np.array([0.0, -8.0]))
    assert resolved(unlikely) is (sigma < 500.0)


def test_places_under_other_models():
    bank, which = random_bank(6, 3, EXACT), models()
    bank.mean[:, :2] = [[0.0, 0.0], [9000.0, 0.0], [0.0, 9000.0]]
    spread = spread_over(bank, which)
    assert len(spread) == 3 * len(which.sigma)
    same(spread.moments(), bank.moments())
    np.testing.assert_allclose(spread.of_models,
                               which.log_prior + bank.log_evidence)  # fmt: skip
    np.testing.assert_allclose(spread.covariance[0, 7:, 7:], np.diag(which.initial[0] ** 2))


def test_faults_that_readings_do_not_speak_for_are_not_published():
    which = models()
    bank = Hypotheses.before(which, np.diag(SIGMA**2))
    shares = np.bincount(which.family, np.exp(which.log_prior))
    assert bank.faults[BIASED] == pytest.approx(shares[BIASED])
    assert set(which.family[bank.credible().which]) == {NONE}
    more = np.where(which.family == LATE, np.log(2.0 * CREDIBLE), 0.0)
    later = replace(bank, log_weight=bank.log_weight + more)
    assert set(which.family[later.credible().which]) == {NONE, LATE}


@given(seeds)
def test_information_that_is_withdrawn_is_no_longer_known(seed):
    bank, prior = random_bank(seed, 4), np.diag(SIGMA**2)
    effect = np.random.default_rng(seed).standard_normal(7) / SIGMA
    square = np.einsum("i,kij,j->k", effect, bank.covariance[:, :7, :7], effect)
    size = np.sqrt((square + (bank.mean[:, :7] @ effect) ** 2).max())
    told = Information(effect / (10.0 * size), np.outer(effect, effect) / (10.0 * size**2))
    after = bank.informed(told, prior)
    assert (after.log_weight != bank.log_weight).all()
    before = after.informed(Information(-told.vector, -told.matrix), prior)
    for k in range(len(bank)):
        same((before.mean[k], before.covariance[k]), (bank.mean[k], bank.covariance[k]), 1e-6)
    np.testing.assert_allclose(before.log_weight, bank.log_weight, atol=1e-6)


def test_more_than_is_known_cannot_be_withdrawn():
    bank, prior = random_bank(0, 2), np.diag(SIGMA**2)
    assert bank.informed(Information(np.zeros(7), 0.0 * prior), prior) is bank
    after = bank.informed(Information(np.ones(7), -4.0 * np.linalg.inv(prior)), prior)
    before, wider = (one.covariance[:, :7, :7] for one in (bank, after))
    ratio = np.linalg.eigvals(np.linalg.solve(before, wider)).real
    assert (ratio > 1.0 - 1e-9).all()
    assert (ratio.max(axis=1) > 1.1).all()
    assert (ratio.max(axis=1) < LARGEST_RATIO + 1e-9).all()


def told_again_and_again(growth, jump, times=30):
    """A bank of a navigator that grows, while satellites take it back by as much each time."""
    before = Hypotheses.before(models(without=frozenset()), np.diag(SIGMA**2))
    bank, prior = before, np.diag(SIGMA**2)
    without = prior + growth
    told = Aided(0.0, without, jump * np.sqrt(np.diag(growth)))
    for _ in range(times):
        bank = bank.carried(np.eye(7), growth).aided(told, prior)
    return before, bank


def share_of(bank, which):
    return float(bank.weight @ which[bank.which])


def test_satellites_make_no_model_more_probable_than_it_was():
    # as slow errors of satellites do: jumps that growth of the navigator would explain
    growth = np.diag(SIGMA**2)
    before, bank = told_again_and_again(growth, np.full(7, 5.0))
    faster = before.models.growth > 1.0
    assert share_of(bank, faster) == pytest.approx(share_of(before, faster), rel=0.1)


def test_satellites_speak_against_growth_that_is_not_there():
    growth = np.diag(SIGMA**2)
    before, bank = told_again_and_again(growth, np.zeros(7))
    faster = before.models.growth > 1.0
    assert share_of(bank, faster) < 0.01 * share_of(before, faster)


def test_satellites_are_neither_for_nor_against_their_being_wrong():
    for jump in (0.0, 5.0):
        before, bank = told_again_and_again(np.diag(SIGMA**2), np.full(7, jump))
        wrong = before.models.family == DECEIVED
        assert share_of(bank, wrong) == pytest.approx(share_of(before, wrong), rel=1e-6)
