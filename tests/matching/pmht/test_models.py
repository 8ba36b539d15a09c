"""What the bank thinks possible, and how likely before any reading."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.bank import models, states_of
from helpers.batches import field_map_of, make_batch, wavy
from isogal.matching.parameters import InstrumentErrors, Parameters
from isogal.matching.path import FilterPath
from isogal.matching.pmht.models import (
    BIASED,
    COARSE,
    COARSE_SHARES,
    DECEIVED,
    FAULTS,
    FILTERED,
    LATE,
    NAVIGATOR,
    NOISIER,
    NONE,
    SHAKEN,
    UNHEARD_OF,
    Assumed,
    assumed,
    few,
    models_of,
)
from isogal.matching.pmht.states import BIAS, DELAY, UNKNOWN, States
from isogal.passage import History
from isogal.scenario import Matcher

ROUGH = field_map_of(wavy)
UNTOLD = models(without=frozenset())
TOLD = models(sigma=3e-5, length=2000.0)


def probability(which, chosen) -> float:
    return float(np.exp(which.log_prior[chosen]).sum())


@pytest.mark.parametrize("which", [UNTOLD, TOLD, models(bias=1e-5), models(sigma=0.0, trust=1.0)])
def test_priors_sum_to_one(which):
    assert probability(which, slice(None)) == pytest.approx(1.0)


def test_each_fault_has_its_probability_whatever_the_map_s_error():
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


@pytest.mark.parametrize(("changes", "told", "gone"), [
    ({}, {}, set()), ({}, {"bias_sigma": 1e-5}, {BIASED}), ({"bias_walk": 1e-7}, {}, {BIASED}),
    ({"delay_sigma": 2.0}, {}, {LATE}), (None, {}, {DECEIVED}),
    ({"filter_path": FilterPath(30.0, np.zeros((30, 1, 2)), np.ones(1))}, {}, {FILTERED}),
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


def test_a_reading_of_several_numbers_has_no_bias_or_delay():
    nothing = np.zeros(0)
    states = replace(states_of(2), sigma=nothing, time=nothing, walk=nothing, unknown=0)
    which = models_of(Assumed(noise=1e-9, scale=1e-8, rough=1e-9), states)
    assert set(which.family) == {NONE, NOISIER, NAVIGATOR, COARSE}
    assert which.initial.shape[1] == 2


def test_told_bias_and_delay_are_states_of_all_models():
    told = frozenset({BIASED, LATE})
    which = models(bias=2e-5, drift=1e-9, delay=3.0, without=told)
    last = which.initial[:, -len(UNKNOWN) :]
    np.testing.assert_array_equal(last[:, :DELAY], [[2e-5, 1e-9]] * len(which.sigma))
    filtered = which.family == FILTERED  # whose time constant is not known to the second either
    assert (last[~filtered, DELAY] == 3.0).all()
    assert (last[filtered, DELAY] > 3.0).all()


def test_a_search_has_few_models():
    part = few(UNTOLD, 1e-5)
    assert part.sigma.min() == 0.0
    least, *_ = sigmas = np.unique(part.sigma[part.sigma > 0.0])
    assert least > 0.4e-5
    assert (np.diff(np.log(sigmas)) > np.log(1.9)).all()
    assert sigmas[-1] == UNTOLD.sigma[UNTOLD.family == NONE].max()
    assert (part.family == NONE).all()
    assert np.exp(part.log_prior).sum() == pytest.approx(1.0)
    assert len(few(models(sigma=0.0, trust=1.0), 1e-5).sigma) == 1


def test_a_walking_bias_is_a_state_that_begins_at_nothing():
    states = replace(states_of(), walk=1e-7 * np.eye(len(UNKNOWN))[BIAS])
    known = Assumed(noise=1e-5, scale=1e-4, rough=1e-5, without=frozenset({BIASED}))
    which = models_of(known, states)
    assert (which.initial[:, 1 + BIAS] == 0.0).all()
    assert all(8 + BIAS in used[:size] for used, size in zip(which.used, which.sizes, strict=True))
