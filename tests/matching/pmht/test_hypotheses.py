"""The bank: what is thought possible and how likely before any reading, what splits, merges and
updates keep, and the cells of a search."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from helpers.bank import HERE, PLANE, SLOPE, models, moments_of, random_bank, states_of
from helpers.batches import field_map_of, make_batch, wavy
from isogal.matching.information import LARGEST_RATIO
from isogal.matching.interfaces import Information
from isogal.matching.pmht.hypotheses import (
    CREDIBLE,
    FLOOR,
    Hypotheses,
)
from isogal.matching.pmht.models import (
    BIASED,
    DECEIVED,
    FAULTS,
    LATE,
    NOISIER,
    NONE,
    Assumed,
    few,
    models_of,
)
from isogal.matching.pmht.rows import rows_of
from isogal.passage import Aided

ROUGH = field_map_of(wavy)
SIGMA = np.array([300.0, 200.0, 0.3, 0.2, 5e-5, 5e-5, 5e-4])
EXACT = models(sigma=0.0, trust=1.0)
TO_THE_LETTER = models(sigma=1e-5, trust=1.0)


def same(a, b, within=1e-9):
    scale = np.sqrt(np.diag(b[1]))
    np.testing.assert_allclose(a[0] / scale, b[0] / scale, atol=within)
    np.testing.assert_allclose(
        a[1] / scale / scale[:, None], b[1] / scale / scale[:, None], atol=within
    )


def rows(field_map=ROUGH, scans=15, which=EXACT, **keys):
    batch, _ = make_batch(field_map, scans=scans, **keys)
    return rows_of(batch, field_map, states_of(), which.lengths, None)[0]


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
    without = prior + growth
    told = Aided(0.0, without, jump * np.sqrt(np.diag(growth)))
    for _ in range(times):
        bank = bank.carried(np.eye(7), growth).aided(told, prior)
    return before, bank


def share_of(bank, which):
    return float(bank.weight @ which[bank.which])


def test_satellites_speak_against_growth_that_is_not_there_and_for_nothing():
    """Slow errors of satellites are jumps that growth of the navigator would explain: they make no
    model more probable, nor say anything of the satellites' being wrong."""
    for jump in (0.0, 5.0):
        before, bank = told_again_and_again(np.diag(SIGMA**2), np.full(7, jump))
        wrong = before.models.family == DECEIVED
        assert share_of(bank, wrong) == pytest.approx(share_of(before, wrong), rel=1e-6)
        faster = before.models.growth > 1.0
        if jump:
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


def test_to_the_letter_there_is_one_model():
    for which in (models(sigma=3e-5, trust=1.0), models(sigma=0.0, trust=1.0)):
        assert len(which.sigma) == 1
        assert which.family[0] == NONE
    assert models(sigma=3e-5, trust=1.0, length=700.0).length[0] == 700.0
    assert which.initial[0, 0] == 0.0  # a map without error has no state for it
    assert which.sizes[0] == 7


def test_a_gradiometer_of_one_channel_has_no_states_of_which_a_search_asks():
    alone = replace(states_of(), names=(), sigma=np.zeros(0), time=np.zeros(0), walk=np.zeros(0))
    alone = replace(alone, unknown=0, smooth=False, channels=1)
    every = models_of(Assumed(noise=1e-5, scale=1e-4, rough=1e-5), alone)
    assert every.initial.shape[1] == 1
    assert set(few(every, 1e-5, np.inf, True).family) == {NONE, NOISIER}


def test_what_is_told_is_right_within_a_factor():
    plain = (TOLD.family == NONE) & (TOLD.sigma > 0.0)
    weight = np.exp(TOLD.log_prior[plain])
    weight /= weight.sum()
    off = np.log2(TOLD.sigma[plain] / 3e-5)
    assert weight @ off == pytest.approx(0.0, abs=0.05)
    assert weight @ off**2 == pytest.approx(1.0, rel=0.25)  # trust 2 is a 1-sigma
    best = np.argmax(weight)
    assert (TOLD.sigma[plain][best], TOLD.length[plain][best]) == (3e-5, 2000.0)
