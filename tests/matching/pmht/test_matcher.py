"""The default matcher as a whole: batch after batch, alone and among others, and odd data."""

import json
from dataclasses import replace

import numpy as np
import pytest

from helpers.bank import LETTER, PLANE, close, flown, pmht, posterior_of
from helpers.batches import field_map_of, make_batch, wavy
from isogal import checkpoints
from isogal.checkpoints import Saved
from isogal.matching.interfaces import LOST_COVARIANCE
from isogal.matching.pmht import matcher as matcher_of
from isogal.matching.pmht.matcher import REFUSED, Pmht
from isogal.matching.pmht.search import WIDE_M, unaided
from isogal.passage import History
from isogal.scenario import Matcher

ERROR = (250.0, -300.0, 0.03, 0.02)
ROUGH = field_map_of(wavy)
UNTOLD = Pmht.from_settings(Matcher())


def flight(legs=3, matcher=UNTOLD, field_map=ROUGH, **keys):
    return list(flown(field_map, matcher, legs, **keys))


def as_bytes(memory) -> bytes:
    return checkpoints.encode("me", Saved(0, memory), lambda value: value is ROUGH)


def test_a_checkpoint_goes_on_as_if_nothing_had_been():
    """In another matcher; and the memory that went in is as it was."""
    *_, (_, _, memory, _), (batch, expected, *_) = flight(4)
    text = checkpoints.encode("me", Saved(5, memory))
    back = checkpoints.decode(text, "me", "here").content
    before = as_bytes(memory)
    assert as_bytes(back) == before
    first, after = UNTOLD.match(batch, ROUGH, memory)
    assert as_bytes(memory) == before
    again, later = Pmht.from_settings(Matcher()).match(batch, ROUGH, back)
    assert as_bytes(after) == as_bytes(later)
    for fix in (first, again):
        assert (fix.latitude, fix.longitude) == (expected.latitude, expected.longitude)
        np.testing.assert_array_equal(fix.information.matrix, expected.information.matrix)
    assert json.dumps({k: float(v) for k, v in again.diagnostics.items()})


@pytest.mark.parametrize("taken", [True, False])
def test_a_fix_that_the_navigator_did_not_take_is_known_not_to_be(taken):
    """The memory is about the navigator as it is, and its covariance is that of the navigator."""
    *_, (batch, fix, memory, error) = flight(REFUSED, pmht(**LETTER), taken=taken)
    bank = memory.fields[0].bank.moved(-memory.taken)
    mean, covariance = bank.moments()
    off = (error - mean[:4]) / np.sqrt(np.diag(covariance))[:4]
    assert np.abs(off).max() < 4.0
    close(posterior_of(fix, batch.prior), (mean[:4], covariance[:4, :4]), 0.05)
    np.testing.assert_allclose(
        memory.covariance[:4, :4], posterior_of(fix, batch.prior)[1], rtol=0.02, atol=1e-6
    )


@pytest.mark.parametrize("taken", [True, False])
def test_a_navigator_that_takes_no_fix_is_widened(taken):
    """It has been misled by earlier ones: the bank knows all that it knew."""
    legs = flight(REFUSED + 2, pmht(**LETTER), taken=taken)
    widened = [fix.widened is not None for _, fix, *_ in legs]
    assert widened == [False] * REFUSED + [not taken] * 2
    assert not any(fix.reset for _, fix, *_ in legs)
    batch, fix, _, error = legs[-1]
    more = 0.0 if taken else fix.widened[:4, :4]
    mean, covariance = posterior_of(fix, batch.prior + more)
    assert (np.abs(np.array(error) - mean[:4]) < 4.0 * np.sqrt(np.diag(covariance)[:4])).all()


def test_what_a_navigator_knows_by_a_fix_it_took_otherwise_is_not_counted_twice():
    """Of its several states the fix has left one, which is narrower and elsewhere: the bank begins
    anew there, and is not drawn towards it."""
    ((batch, _, memory, _),) = flight(1, pmht(**LETTER))
    left = 0.01 * memory.covariance
    later = replace(
        batch,
        time=batch.time + batch.time[-1] - batch.time[0],
        history=History(0.3 * memory.taken - 5.0 * np.sqrt(np.diag(memory.covariance))),
        covariance=left,
    )
    mean, covariance = memory.propagated(later).fields[0].bank.moments()
    np.testing.assert_allclose(mean[:4], 0.0, atol=1e-9)
    np.testing.assert_allclose(covariance[:4, :4], left[:4, :4], rtol=1e-6, atol=1e-9)


def test_a_fix_that_would_have_widened_and_was_refused_narrows_nothing():
    """The navigator is narrower than after the fix, and has learnt nothing."""
    ((batch, _, memory, _),) = flight(1, pmht(**LETTER))
    known = batch.covariance
    taken = np.r_[6.0 * np.sqrt(known[0, 0]), np.zeros(6)]
    last = memory.diverged.last._replace(left=4.0 * known)
    memory = memory._replace(untaken=known, diverged=memory.diverged.with_last(last))
    memory = memory.moved(taken - memory.taken)
    before = memory.fields[0].bank
    later = replace(
        batch, time=batch.time + batch.time[-1] - batch.time[0], history=History(np.zeros(7))
    )
    first = len(later) - later.new - 1
    back = later.backward[max(first, 0)].copy()
    back[:2] -= (later.time[max(first, 0)] - last.time) * back[2:4]
    forward = np.linalg.inv(back)
    after = memory.propagated(replace(later, covariance=forward @ known @ forward.T))
    bank = after.fields[0].bank
    whole = forward @ before.moments()[1] @ forward.T
    np.testing.assert_allclose(bank.moments()[1], whole, rtol=1e-6, atol=1e-9 * whole.max())


@pytest.mark.parametrize(
    ("sigma", "one_place", "share", "given"),
    [
        (3000.0, True, 0.6, True),
        (3000.0, True, 0.4, False),
        (3000.0, False, 0.6, False),
        (1500.0, False, 0.4, True),
    ],
)
def test_a_navigator_lost_among_kilometres_gets_no_fix(
    monkeypatch, sigma, one_place, share, given
):
    """But where its hypotheses are one place and the readings of the last hour speak for it."""
    *_, (_, _, memory, _), (batch, right, *_) = flight(4)
    assert right.published
    wide = batch.covariance.copy()
    wide[:2, :2] += sigma**2 * np.eye(2)
    monkeypatch.setattr(matcher_of, "resolved", lambda bank: one_place)
    monkeypatch.setattr(matcher_of, "probability_at", lambda *_: share)
    fix, after = UNTOLD.match(replace(batch, covariance=wide), ROUGH, memory)
    assert fix.published == given
    if not given:
        assert fix.reason == "the navigator is too unsure of its place, 1-sigma of 3 km"
        assert fix.diagnostics["map_sigma"] > 0.0
        assert after.diverged.last.rows is not None  # the hypotheses have taken them


@pytest.mark.parametrize(("what", "reason"), [
    ({"reading": np.full(15, np.nan)}, "there is no new reading"),
    ({"sigma": np.zeros(15)}, "sigma of a reading is not positive"),
])  # fmt: skip
def test_the_navigator_is_followed_through_20_minutes_without_readings(what, reason):
    """Each batch says what became of the navigator since the one before, so that none may be left
    out."""

    def change(batch, number):
        return replace(batch, **what) if number else batch

    legs = flight(9, pmht(**LETTER), change=change)
    assert [fix.reason for _, fix, *_ in legs[1:]] == [reason] * 8
    forward = np.eye(7)
    forward[:2, 2:4] = 8 * 150.0 * np.eye(2)
    first, last = legs[0][2], legs[-1][2]
    mean, covariance = first.fields[0].bank.moments()
    later, wider = last.fields[0].bank.moments()
    np.testing.assert_allclose(later[:4], (forward @ mean)[:4], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        wider[:4, :4], (forward @ covariance @ forward.T)[:4, :4], rtol=1e-4
    )
    past = last.diverged.past
    _, _, A, b = unaided(past, last.diverged.start)
    np.testing.assert_allclose(A, forward, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(b, -forward @ past[0].taken, rtol=1e-9, atol=1e-12)
    assert past[0].rows is not None
    assert all(one.rows is None for one in past[1:])


def test_off_the_map_there_is_no_fix():
    batch, _ = make_batch(PLANE, ERROR)
    away = replace(batch, latitude=batch.latitude + 0.2)
    fix, memory = UNTOLD.match(away, PLANE, None)
    assert not fix.published
    assert "on the map" in fix.reason
    fix, _ = UNTOLD.match(batch, PLANE, memory)
    assert fix.published


def test_a_map_without_features_tells_nothing():
    flat = field_map_of(lambda north, east: 0.0 * (north + east), step=2000.0)
    batch, _ = make_batch(flat, ERROR)
    for matcher in (UNTOLD, pmht(), pmht(map_sigma=1e-5)):
        fix, _ = matcher.match(batch, flat, None)
        if fix.published:
            told = posterior_of(fix, batch.prior)[1]
            np.testing.assert_allclose(np.diag(told), np.diag(batch.prior), rtol=0.05)
        else:
            assert fix.reason == "the batch tells nothing that the navigator does not know"


@pytest.mark.parametrize("value", [-1e300, np.inf])
def test_readings_that_cannot_be_true_do_no_harm(value):
    batch, _ = make_batch(ROUGH, (60.0, -50.0, 0.0, 0.0), prior_sigma=(100.0, 0.02))
    good, _ = UNTOLD.match(batch, ROUGH, None)
    reading = batch.reading.copy()
    reading[7] = value
    fix, _ = UNTOLD.match(replace(batch, reading=reading), ROUGH, None)
    if fix.published:
        mean, covariance = posterior_of(fix, batch.prior)
        expected, _ = posterior_of(good, batch.prior)
        assert np.isfinite(fix.covariance).all()
        assert (np.abs(mean - expected) < 3.0 * np.sqrt(np.diag(covariance))).all()


def test_spikes_are_left_out():
    """Five of 30 readings are off by 30 sigma: as if they were not there."""
    for seed in range(4):
        batch, _ = make_batch(ROUGH, (60.0, -50.0, 0.0, 0.0), prior_sigma=(100.0, 0.02), seed=seed)
        spikes = np.zeros(30)
        spikes[[3, 9, 10, 20, 28]] = 3e-4
        fix, _ = pmht().match(replace(batch, reading=batch.reading + spikes), ROUGH, None)
        without = replace(batch, reading=np.where(spikes > 0.0, np.nan, batch.reading))
        expected, _ = pmht().match(without, ROUGH, None)
        got, wanted = (posterior_of(one, batch.prior) for one in (fix, expected))
        close(got, wanted, 0.3)


def test_candidates_are_the_hypotheses_at_each_scan():
    batch, truth = make_batch(ROUGH, ERROR)
    fix, memory = UNTOLD.match(batch, ROUGH, None)
    shown = fix.candidates
    count = len(shown.weight) // 30
    assert 1 <= count <= 64
    np.testing.assert_allclose(np.bincount(shown.scan, shown.weight), 1.0)  # within each scan
    assert (shown.weight > 0.0).all()
    last = shown.scan == 29
    best = np.argmax(shown.weight[last])
    assert abs(shown.latitude[last][best] - truth.latitude) < 1e-4
    assert len(memory.fields[0].bank) >= count


def test_a_start_told_to_be_wide_is_searched_for():
    """5 km: declined while cells are too many, and until the place is known; then told to the
    navigator."""
    found, begun = None, None
    for number, (batch, fix, memory, error) in enumerate(  # noqa: B007
        flown(ROUGH, pmht(map_sigma=1e-4, **LETTER), 10, (4000.0, -5500.0, 0.05, -0.05),
              (5000.0, 0.1), start=(-12e3, -12e3))
    ):  # fmt: skip
        if fix.published:
            found = number
            break
        assert memory.fields[0].bank is None
        assert fix.reason == "the place is searched for"
        if begun is None and memory.diverged.search is not None:
            begun = number
    assert found is not None and begun is not None and 0 < begun < found
    mean, covariance = posterior_of(fix, batch.prior)
    assert not fix.reset
    sigma = np.sqrt(np.trace(covariance[:2, :2]))
    assert np.hypot(*(mean - error)[:2]) < 4.0 * sigma < 4.0 * WIDE_M


def test_a_navigator_that_has_diverged_is_told_so():
    """10 km off, and sure of itself: found, and its covariance is to grow before the fix."""
    resets = []
    for number, (batch, fix, memory, error) in enumerate(  # noqa: B007
        flown(ROUGH, UNTOLD, 14, (8000.0, -6000.0, 0.1, -0.1), (100.0, 0.05), start=(-16e3, -16e3))
    ):  # fmt: skip
        if fix.reset:
            resets.append(number)
            prior = batch.prior + fix.widening[:4, :4]
            assert (np.diag(fix.widening - LOST_COVARIANCE) >= 0.0).all()
            mean, covariance = posterior_of(fix, prior)
            assert np.hypot(*(mean - error)[:2]) < 5.0 * np.sqrt(np.trace(covariance[:2, :2]))
            break
    assert len(resets) == 1
    assert memory.diverged.found is None
    assert memory.fields[0].bank is not None


@pytest.mark.parametrize(("away", "told"), [(0.0, False), (2000.0, True)])
def test_only_a_navigator_that_is_elsewhere_is_told_so(monkeypatch, away, told):
    """Where a search finds the navigator where it believes to be, but with another attitude, say,
    its covariance grows by as much, or it would not take the fix."""
    batch, _ = make_batch(ROUGH, (60.0, -50.0, 0.0, 0.0), prior_sigma=(100.0, 0.02))

    def found(memory, first, field_map):
        field = memory.fields[first]
        bank = field.bank.moved(np.array([away, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0]))
        return memory._replace(fields={first: field._replace(bank=bank)}), True

    monkeypatch.setattr(matcher_of, "decided", found)
    fix, memory = UNTOLD.match(batch, ROUGH, None)
    mean, covariance = memory.fields[0].bank.moved(-memory.taken).moments()
    assert fix.reset is told
    np.testing.assert_allclose(fix.widened, covariance + np.outer(mean, mean), rtol=1e-6)
    assert fix.widened[2, 2] > 0.4**2


def test_a_healthy_navigator_is_not():
    for seed in range(3):
        random = np.random.default_rng(seed)
        error = random.standard_normal(4) * [100.0, 100.0, 0.03, 0.03]
        for _, fix, _, _ in flown(ROUGH, UNTOLD, 12, error, (100.0, 0.03), start=(-16e3, -16e3)):
            assert not fix.reset
