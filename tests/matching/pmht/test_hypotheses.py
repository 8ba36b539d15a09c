"""The bank: what is thought possible and how likely before any reading, what splits, merges and
updates keep, and the cells of a search."""

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
from isogal.inertial.error_state import BATCH_STATES
from isogal.matching.information import LARGEST_RATIO
from isogal.matching.interfaces import Information
from isogal.matching.parameters import InstrumentErrors, Parameters
from isogal.matching.pmht import hypotheses as bank_of
from isogal.matching.pmht.cells import Seen, in_common, low_pass, residuals_at
from isogal.matching.pmht.hypotheses import (
    CREDIBLE,
    FLOOR,
    NEGLIGIBLE,
    Hypotheses,
    with_needed,
)
from isogal.matching.pmht.memory import steps
from isogal.matching.pmht.models import (
    BIASED,
    COARSE,
    COARSE_SHARES,
    DECADES,
    DECEIVED,
    FAULTS,
    FILTERED,
    FINER_LAGS,
    LATE,
    NOISIER,
    NONE,
    SHAKEN,
    UNHEARD_OF,
    Assumed,
    Models,
    assumed,
    few,
    models_of,
)
from isogal.matching.pmht.rows import rows_of
from isogal.matching.pmht.search import noisiest, resolved
from isogal.matching.pmht.states import DELAY, DRIFT, UNKNOWN, States
from isogal.passage import History, Passage
from isogal.scenario import Matcher
from isogal.sensors import lag

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


def carried(bank, before, forward, told):
    passage = Passage.of_dynamics(0.0, before, *steps(before, forward, told))
    np.testing.assert_allclose(passage.after, told, rtol=1e-5, atol=1e-6 * SIGMA.min() ** 2)
    return bank.passed(passage, np.arange(7))


@given(seeds)
def test_growth_of_the_navigator_joins_each_and_what_it_learnt_narrows_each(seed):
    before = random_covariance(SIGMA, seed)
    forward = np.eye(7) + np.diag([60.0, 60.0, 0.0, 0.0, 0.0], 2)
    random = np.random.default_rng(seed)
    root = random.standard_normal((7, 7)) * SIGMA[:, None] * 0.3
    prior = forward @ before @ forward.T + root @ root.T
    bank = carried(Hypotheses.before(EXACT, before), before, forward, prior)
    same(bank.moments(), (np.zeros(7), prior), 1e-7)
    learnt = forward @ before @ forward.T
    gain = learnt[:, :1] / (learnt[0, 0] + 50.0**2)
    told = learnt - gain @ learnt[:1]  # an aid has measured one position
    bank = carried(Hypotheses.before(EXACT, before), before, forward, told)
    same(bank.moments(), (np.zeros(7), told), 1e-4)  # its path is an arc


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


def test_a_noise_that_becomes_likely_has_filters_beside_it():
    """What they give is not known then; the place is."""
    which = models()
    plain = (which.length == 4000.0) & (which.sigma == 0.0)
    of = {
        (family, time): np.flatnonzero(
            plain & (which.family == family) & (which.noise == 10.0) & (which.lag == time)
        )[0]
        for family, time in ((NOISIER, 0.0), (FILTERED, 15.0), (FILTERED, 60.0))
    }
    assert set(which.quieter[[of[FILTERED, 15.0], of[FILTERED, 60.0]]]) == {of[NOISIER, 0.0]}
    bank = Hypotheses.before(which, np.diag(SIGMA**2))
    noisy = bank.which == of[NOISIER, 0.0]
    bank.mean[noisy, 0] = 70.0
    bank = replace(bank, log_weight=np.where(noisy, 0.0, -80.0))
    there = with_needed(bank.part(noisy | (which.noise[bank.which] == 1.0)), 2)
    for time in (15.0, 60.0):
        begun = there.part(there.which == of[FILTERED, time])
        assert begun.mean[:, 0] == pytest.approx(70.0)
        own = which.initial[of[FILTERED, time], -1]
        assert begun.covariance[:, -1, -1] == pytest.approx(own**2)
    quiet = replace(there, log_weight=np.where(which.noise[there.which] == 1.0, 0.0, -80.0))
    assert set(which.noise[with_needed(quiet, 2).which]) == {1.0}


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


def test_models_keep_places_that_are_not_too_improbable_and_their_best_one():
    """What is improbable at first, as a delay, may be right: it must not have lost its place, nor
    the evidence of all its places."""
    which = models()
    late = np.flatnonzero(which.family == LATE)[:2]
    three = np.r_[np.flatnonzero(which.family == NONE)[:1], late]
    none, near, far = range(3)
    bank = random_bank(2, 9, Models._make(column[three] for column in which))
    bank.which[:] = np.repeat([none, near, far], 3)
    bank.mean[:, 0] = np.tile([0.0, 1e5, 2e5], 3)
    bank.log_weight[:] = [0.0, -3.0, -30.0, -9.0, -14.0, -16.0, -20.0, -20.5, -21.0]
    after = bank.reduced(HERE)
    assert list(np.sort(after.which)) == [none, none, near, near, far]


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


def test_faults_that_readings_do_not_speak_for_are_not_published():
    which = models()
    bank = Hypotheses.before(which, np.diag(SIGMA**2))
    shares = np.bincount(which.family, np.exp(which.log_prior))
    assert bank.faults[BIASED] == pytest.approx(shares[BIASED])
    assert set(which.family[bank.credible().which]) == {NONE}
    more = np.where(which.family == LATE, np.log(2.0 * CREDIBLE), 0.0)
    later = replace(bank, log_weight=bank.log_weight + more)
    assert set(which.family[later.credible().which]) == {NONE, LATE}


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
    told = Passage.of_dynamics(0.0, prior, np.eye(7), growth)
    told = replace(told, jump=jump * np.sqrt(np.diag(growth)))
    for _ in range(times):
        bank = bank.passed(told, np.arange(7)).aided(told, prior)
    return before, bank


def share_of(bank, which):
    return float(bank.weight @ which[bank.which])


def test_satellites_speak_against_growth_that_is_not_there_and_for_nothing():
    """Slow errors of satellites are jumps that growth of the navigator would explain: they make no
    model more probable, nor say anything of the satellites' being wrong."""
    for jump in (1e-6, 5.0):
        before, bank = told_again_and_again(np.diag(SIGMA**2), np.full(7, jump))
        wrong = before.models.family == DECEIVED
        assert share_of(bank, wrong) == pytest.approx(share_of(before, wrong), rel=1e-6)
        faster = before.models.growth > 1.0
        if jump > 1.0:
            assert share_of(bank, faster) == pytest.approx(share_of(before, faster), rel=0.1)
        else:
            assert share_of(bank, faster) < 0.01 * share_of(before, faster)


UNTOLD = models(without=frozenset())
TOLD = models(sigma=3e-5, length=2000.0)


def probability(which, chosen) -> float:
    return float(np.exp(which.log_prior[chosen]).sum())


def test_each_fault_has_its_probability_whatever_the_map_s_error():
    assert probability(UNTOLD, slice(None)) == pytest.approx(1.0)
    for family in {fault.family for fault in FAULTS}:
        expected = sum(fault.probability for fault in FAULTS if fault.family == family)
        assert probability(UNTOLD, UNTOLD.family == family) == pytest.approx(
            expected / sum(fault.probability for fault in FAULTS)
        )


def test_what_a_grid_leaves_out_is_in_proportion_to_its_roughness():
    which = models(rough=2e-5, step=1500.0)
    coarse = which.family == COARSE
    np.testing.assert_allclose(which.sigma[coarse], np.array(COARSE_SHARES) * 2e-5)
    assert set(which.length[coarse]) == {750.0}
    lengths, rough = which.shapes
    assert len(lengths) == len(set(which.shape))
    np.testing.assert_array_equal(lengths[which.shape], which.length)
    np.testing.assert_array_equal(rough[which.shape], np.where(coarse, 2e-5, 0.0))
    assert not (TOLD.family == COARSE).any()
    assert not (models(rough=0.0).family == COARSE).any()


def test_untold_sigmas_are_even_up_to_the_map_s_roughness():
    alone = (UNTOLD.family == NONE) & (np.abs(UNTOLD.length / 4000.0 - 1.0) < 1e-9)
    sigma, log = UNTOLD.sigma[alone], UNTOLD.log_prior[alone]
    small = log[(sigma > 0.0) & (sigma <= 1e-5 * (1.0 + 1e-9))]
    assert np.ptp(small) == pytest.approx(0.0, abs=1e-9)
    assert (np.diff(log[sigma > 1e-5]) < 0.0).all()
    assert sigma[1] == pytest.approx(0.125e-5)
    assert sigma[-1] >= 0.5e-4  # half of the map's scale
    assert sigma[0] == 0.0
    assert log[0] > log[1]


def test_a_search_has_few_models():
    """Every second sigma, up to the largest, and one group for a time constant and a noise."""
    part = few(UNTOLD, 1e-5, np.inf, True)
    assert part.sigma.min() == 0.0
    least, *_ = sigmas = np.unique(part.sigma[part.sigma > 0.0])
    assert least > 0.4e-5
    assert (np.diff(np.log(sigmas)) > np.log(1.9)).all()
    assert sigmas[-1] == UNTOLD.sigma[UNTOLD.family == NONE].max()
    assert set(part.family) == {NONE, BIASED, NOISIER, FILTERED}
    assert part.initial[part.family == BIASED, DRIFT - len(UNKNOWN)].max() == 0.0
    for group in np.unique(part.group):
        of = part.group == group
        assert all(np.ptp(column[of]) == 0.0 for column in (part.lag, part.noise))
    of_filters = {(lag, noise) for lag in (0.0, *FINER_LAGS) for noise in (1.0, *DECADES)}
    assert set(zip(part.lag, part.noise, strict=True)) == of_filters
    assert np.exp(part.log_prior).sum() == pytest.approx(1.0)
    through = [part.log_prior[part.lag == lag].sum() for lag in FINER_LAGS]
    assert np.ptp(through) < 1e-9
    assert set(few(UNTOLD, 1e-5, 50.0, True).noise) == {1.0, 10.0}
    assert len(few(models(sigma=0.0, trust=1.0), 1e-5, np.inf, True).sigma) == 1


def test_a_gradiometer_of_one_channel_has_no_states_of_which_a_search_asks():
    alone = replace(states_of(), names=(), sigma=np.zeros(0), time=np.zeros(0), walk=np.zeros(0))
    alone = replace(alone, unknown=0, smooth=False, channels=1)
    every = models_of(Assumed(noise=1e-5, scale=1e-4, rough=1e-5), alone)
    assert every.initial.shape[1] == 1
    assert set(few(every, 1e-5, np.inf, True).family) == {NONE, NOISIER}


@pytest.mark.parametrize("factor", [1.0, 30.0])
@pytest.mark.parametrize("count", [6, 60, 240])
def test_readings_that_change_little_are_of_little_noise(factor, count):
    """Noise of the true variance is thought possible but once in a thousand times, and of many it
    is known to half a decade; what the map adds takes no noise from what is possible."""
    rng, some = np.random.default_rng(count), rows(scans=count)
    white = np.sqrt(factor * some.noise) * rng.standard_normal((1000, count))
    map_too = some.level if factor == 1.0 else np.zeros(count)
    found = np.array([noisiest(some._replace(level=map_too + one)) for one in white])
    assert (found < factor).mean() < 0.005
    if count == 240 and factor != 1.0:
        assert np.median(found) < factor * math.sqrt(10.0)


def test_a_told_error_may_be_another_one():
    for which, told in ((models(sigma=0.0), 0.0), (TOLD, 3e-5)):
        another = np.abs(np.log2(np.maximum(which.sigma, 1e-9) / max(told, 1e-9))) > 4.0
        share = probability(which, another) / UNHEARD_OF
        assert 0.2 < share < 1.0 + 1e-9


def test_what_is_told_is_right_within_a_factor():
    plain = (TOLD.family == NONE) & (TOLD.sigma > 0.0)
    weight = np.exp(TOLD.log_prior[plain])
    weight /= weight.sum()
    off = np.log2(TOLD.sigma[plain] / 3e-5)
    assert weight @ off == pytest.approx(0.0, abs=0.05)
    assert weight @ off**2 == pytest.approx(1.0, rel=0.25)  # trust 2 is a 1-sigma
    best = np.argmax(weight)
    assert (TOLD.sigma[plain][best], TOLD.length[plain][best]) == (3e-5, 2000.0)


@pytest.mark.parametrize(("changes", "told", "gone"), [
    ({}, {}, set()), ({}, {"bias_sigma": 1e-5}, {BIASED}), ({"bias_walk": 1e-7}, {}, {BIASED}),
    ({"delay_sigma": 2.0}, {}, {LATE}), (None, {}, {DECEIVED}),
    ({"filter_time": 30.0}, {}, {FILTERED}),
    ({"parameters": Parameters(("coupling_forward",), np.ones(1), np.ones((30, 1)))}, {},
     {SHAKEN}),
])  # fmt: skip
def test_what_is_told_is_no_fault(changes, told, gone):
    """Changes of the instrument; None = without satellites."""
    history, instrument = (
        History(satellites=changes is not None),
        InstrumentErrors(**changes or {}),
    )
    batch, _ = make_batch(ROUGH, instrument=instrument, history=history)
    known = assumed(Matcher(**told), batch, ROUGH)
    which = models_of(known, States.of(batch, ROUGH))
    assert set(which.family) == {fault.family for fault in FAULTS} - gone


ERROR = (2000.0, -1500.0, 0.0, 0.0)


def test_what_states_put_into_rows_in_common():
    """A random walk and a process that forgets, by the sum over all that has joined them."""
    random = np.random.default_rng(1)
    effect, decay = random.standard_normal((6, 2)), np.array([1.0, 0.8])
    start, fresh = np.array([4.0, 1.0]), random.uniform(0.1, 1.0, (6, 2))
    expected, covariance = np.zeros((6, 6)), np.zeros((6, 2, 2))
    for s in range(2):
        joined = np.r_[start[s], fresh[:, s]]
        share = np.array([[decay[s] ** (t - k) * (t >= k) for k in range(-1, 6)]
                          for t in range(6)])  # fmt: skip
        of_state = (share * joined) @ share.T
        expected += effect[:, s, None] * of_state * effect[:, s]
        covariance[:, s, s] = np.diag(of_state)
    gone = -np.arange(6)[:, None] * np.log(decay)
    left = np.exp(-np.abs(gone[:, None] - gone))
    found = in_common(effect, covariance, left, np.arange(6.0))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def seen_of(bias: float) -> tuple[Seen, np.ndarray]:
    """Readings at a place 2.5 km from where the navigator believes to be, with a bias of 2 mGal,
    and what is told of it."""
    batch, _ = make_batch(ROUGH, ERROR, 60)
    batch = replace(batch, reading=batch.reading + 2e-5)
    states = States.of(batch, ROUGH)
    rows, _ = rows_of(batch, ROUGH, states, np.array([4000.0]), None)
    told = models_of(
        Assumed(noise=1e-5, scale=1e-3, rough=1e-5, sigma=0.0, trust=1.0, bias=bias), states
    )
    rest = np.zeros((len(rows.level), BATCH_STATES, BATCH_STATES))
    exact = few(told, 1e-5, np.inf, False)
    return Seen.of(rows, rest, ROUGH, exact), np.array([ERROR[:2], (0.0, 0.0)])


def test_what_a_filter_gives_is_a_mean_of_what_was_sensed():
    time, sensed = 30.0 * np.arange(40.0), np.random.default_rng(2).standard_normal(40)
    F = low_pass(time, 45.0)
    np.testing.assert_allclose(F @ sensed, lag.low_pass(sensed, 30.0, 45.0), rtol=1e-9)
    uneven = np.delete(time, [7, 8, 20])
    line = low_pass(uneven, 45.0) @ uneven
    assert (line + 45.0)[-10:] == pytest.approx(uneven[-10:], abs=0.01)  # as old as the filter
    np.testing.assert_array_equal(low_pass(time, 0.0), np.eye(40))
    twice = low_pass(np.array([0.0, 30.0, 30.0]), 45.0)
    np.testing.assert_allclose(twice[2], twice[1], atol=1e-5)


def test_a_place_is_found_by_readings_through_a_filter():
    """Cells are ranked by time constants: the place is the best of all by the right one alone."""
    truth = np.array([2000.0, -1500.0, 0.0, 0.0])
    batch, _ = make_batch(ROUGH, truth, 60, seed=None)
    through = lag.low_pass(batch.reading, float(batch.time[1] - batch.time[0]), 40.0)
    noise = 2e-6 * np.random.default_rng(5).standard_normal(60)
    batch = replace(batch, reading=through + noise, sigma=np.full(60, 2e-6))
    states = States.of(batch, ROUGH)
    every = models_of(Assumed(noise=2e-6, scale=1e-4, rough=1e-5), states)
    lengths, rough = every.shapes
    rows, _ = rows_of(batch, ROUGH, states, lengths, None, rough)
    rest = np.zeros((60, BATCH_STATES, BATCH_STATES))
    seen = Seen.of(rows, rest, ROUGH, few(every, 2e-6, np.inf, False))
    axis = np.linspace(-3000.0, 3000.0, 13)
    centres = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    log = seen.log_evidence(centres, 100.0)
    best = np.array([log[:, seen.models.lag == one].max() for one in (0.0, *FINER_LAGS)])
    assert best.argmax() == 1 + FINER_LAGS.index(40.0)
    which = log[:, seen.models.lag == 40.0].max(axis=1).argmax()
    np.testing.assert_array_equal(centres[which], truth[:2])
    assert best[3] > best[0] + 20.0


def test_a_place_is_found_by_biased_readings():
    truth = np.array([2000.0, -1500.0, 0.0, 0.0])
    batch, _ = make_batch(ROUGH, truth, 60)
    states = States.of(batch, ROUGH)
    every = models_of(Assumed(noise=1e-5, scale=1e-4, rough=1e-5), states)
    lengths, rough = every.shapes
    rows, _ = rows_of(batch, ROUGH, states, lengths, None, rough)
    rest = np.zeros((60, BATCH_STATES, BATCH_STATES))
    found = few(every, 1e-5, 1.0, True)
    seen, off = (
        Seen.of(rows._replace(level=rows.level + more), rest, ROUGH, found) for more in (0.0, 5e-5)
    )
    centres = np.array([truth[:2], truth[:2] + 1000.0])
    biased = found.family == BIASED
    log, with_bias = (one.log_evidence(centres, 100.0)[0] for one in (seen, off))
    # 5 mGal are one 1-sigma of an unspecified bias, which a filter does not change
    assert log[biased].max() - with_bias[biased].max() == pytest.approx(0.5, abs=0.2)
    exact = ~biased & (found.sigma == 0.0) & (found.lag == 0.0)
    assert log[exact] - with_bias[exact] > 100.0
    assert off.log_evidence(centres, 100.0)[1].max() < with_bias[biased].max() - 20.0


def test_a_told_bias_is_counted():
    """As a Gaussian whose covariance has the bias in all readings."""
    (without, centres), (with_bias, _) = seen_of(0.0), seen_of(5e-5)
    residual = residuals_at(with_bias.rows, ROUGH.grid, centres)
    R = np.diag(with_bias.noise) + with_bias.other + 100.0**2 * with_bias.blur
    np.testing.assert_allclose(with_bias.other - without.other, 25e-10, rtol=1e-9)
    square = (np.linalg.solve(np.linalg.cholesky(R), residual) ** 2).sum(axis=0)
    expected = -0.5 * (square + np.linalg.slogdet(R)[1])
    found = with_bias.log_evidence(centres, 100.0)[:, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-3)
    assert found[0] > without.log_evidence(centres, 100.0)[0, 0] + 10.0
