"""Matching recorded tracks: every scalar field, consistency of the fixes, chained batches, edges
of the map."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from helpers.tracks import FIELDS, field_of, made_track
from isogal.earth.frames import horizontal_difference
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.evaluation.consistency import chi_square_interval, nees_per_axis
from isogal.matching.interfaces import declined
from isogal.scenario import Matcher
from isogal.seeds import generator
from isogal.tracks.fields import TrackField
from isogal.tracks.matching import MOST_SHIFTS, Uncertainty, match_fields, match_track
from isogal.tracks.results import as_objects

DISTURBANCE = field_of("disturbance")
PRIOR = Uncertainty(position=800.0)
EXACT = {"map_sigma": 0.0, "bias_sigma": 0.0}  # told: nothing but the readings' white noise


def errors_of(matches, latitude, longitude):
    """(B, 2) north and east errors of the fixes, m; NaN where there is none."""
    ends = [match.rows.stop - 1 for match in matches]
    found = np.array([[m.fix.latitude, m.fix.longitude, m.fix.published] for m in matches])
    off = horizontal_difference(found[:, 0], found[:, 1], latitude[ends], longitude[ends])
    return np.where(found[:, 2:] > 0.0, off, np.nan)


class Recorder:
    """A matcher that keeps its batches and gives no fix."""

    name = "recorder"

    def __init__(self, context=0):
        self.context, self.batches = context, []

    def match(self, batch, field_map, memory):
        self.batches.append(batch)
        return declined(batch, "not matched"), None


def batches_of(track, prior=PRIOR, context=0, chained=False, **settings):
    """The batches that a matcher gets, which gives no fix."""
    recorder = Recorder(context)
    match_track(track, DISTURBANCE, Matcher(**settings), prior, chained=chained, matcher=recorder)
    return recorder.batches


def test_the_same_field_in_another_unit_gives_the_same_fixes():
    """And with an offset."""
    (a,), (b,) = (
        match_track(made_track(one, 30, (300.0, 200.0), sigma)[0], one, Matcher(), PRIOR)
        for one, sigma in ((DISTURBANCE, 1e-5), (field_of("height"), 1e-5 * FIELDS["height"][1]))
    )
    np.testing.assert_allclose(a.fix.covariance, b.fix.covariance, rtol=1e-4)
    places = a.fix.latitude, a.fix.longitude, b.fix.latitude, b.fix.longitude
    assert horizontal_difference(*places) == pytest.approx([0.0, 0.0], abs=0.1)


def test_fixes_are_consistent_with_their_covariance():
    """Position errors drawn from the prior, 24 tracks of one batch: the mean NEES lies in its
    99.9 % interval."""
    nees, settings = [], Matcher(batch_length=20, **EXACT)
    for run in range(24):
        random = generator(7, run, "track")
        error, start = random.normal(0.0, 400.0, 2), tuple(random.uniform(-15e3, 5e3, 2))
        track, *truth = made_track(DISTURBANCE, 20, error, 2e-5, run, start)
        matches = match_track(track, DISTURBANCE, settings, Uncertainty(position=400.0))
        if matches[0].fix.published:
            error = errors_of(matches, *truth)[0]
            nees.append(float(nees_per_axis(error, matches[0].fix.covariance)))
    low, high = chi_square_interval(len(nees), confidence=0.999)
    assert len(nees) >= 21
    assert low < np.mean(nees) < high


def test_chained_batches_know_as_much_as_one_batch_of_all():
    """The noise is white, so the likelihoods of the batches multiply; what the jackknife adds
    differs, with the blocks that it sees."""
    track, _, _ = made_track(DISTURBANCE, count=60, error=(350.0, -250.0), sigma=3e-5)
    settings = Matcher(batch_length=20, **EXACT)
    chained = match_track(track, DISTURBANCE, settings, PRIOR, chained=True)
    whole = match_track(track, DISTURBANCE, Matcher(batch_length=60, **EXACT), PRIOR)[0]
    assert all(match.fix.published for match in chained)
    apart = chained[-1].error[:2] - whole.error[:2]
    sigma = np.sqrt(np.diag(whole.covariance)[:2])
    assert (np.abs(apart) < 0.35 * sigma).all()
    bare = np.sqrt(np.diag(whole.shifts.moments[1]))
    found = np.sqrt(np.diag(chained[-1].covariance)[:2])
    assert (found > 0.85 * bare).all()
    assert (found < 1.15 * sigma).all()
    variances = [np.trace(match.covariance[:2, :2]) for match in chained]
    assert variances[0] > variances[1] > variances[2]


def test_long_tracks_keep_the_posteriors_of_their_first_batches_only():
    """Each has some 20 MB: those of a long track fill the memory."""
    track, _, _ = made_track(DISTURBANCE, count=80, error=(350.0, -250.0), sigma=3e-5)
    field = TrackField("", track, DISTURBANCE, Matcher(batch_length=10, **EXACT))
    matches = match_fields([field], Uncertainty(position=400.0))
    kept = [match.shifts is not None for match in matches]
    assert kept == [True] * MOST_SHIFTS + [False] * 2
    assert all("estimated" in entry for entry in as_objects(matches, [field]))


def test_a_track_too_short_to_be_matched_is_refused():
    track, _, _ = made_track(DISTURBANCE, count=2)
    with pytest.raises(InputError, match="at least 3 readings, has 2"):
        match_track(track, DISTURBANCE, Matcher(batch_length=20), PRIOR)


def test_velocity_error_and_walk_widen_the_prior_between_chained_batches():
    track, _, _ = made_track(DISTURBANCE)
    uncertainty = Uncertainty(position=100.0, velocity=0.5, walk=3000.0)
    batches = batches_of(track, uncertainty, chained=True, batch_length=20)
    age = 200.0 * np.arange(3)
    expected = 100.0**2 + (0.5 * age) ** 2 + 3000.0**2 * age / 3600.0
    np.testing.assert_allclose([batch.prior[0, 0] for batch in batches], expected)
    np.testing.assert_allclose([batch.prior[0, 2] for batch in batches], 0.5**2 * age)
    for batch in batches_of(track, uncertainty, batch_length=20):
        np.testing.assert_allclose(np.diag(batch.prior)[:2], 100.0**2)


@pytest.mark.parametrize(("stride", "context"), [(None, 0), (None, 15), (10, 5)])
def test_each_reading_is_new_in_one_batch_and_context_comes_before(stride, context):
    track, _, _ = made_track(DISTURBANCE, count=64)
    batches = batches_of(track, context=context, batch_length=30, stride=stride)
    seen = np.concatenate([batch.time[-batch.new :] for batch in batches])
    np.testing.assert_array_equal(seen, track.time)
    for batch in batches[1:-1]:
        before = int(np.searchsorted(track.time, batch.time[-1])) + 1
        assert len(batch) == min(30 + context, before)


def test_the_reduction_with_a_wrong_latitude_is_allowed_for():
    """Disturbances reduced with normal gravity at the navigator's latitude, 2 km from the true
    one: 1.6 mGal."""
    track, latitude, longitude = made_track(DISTURBANCE, error=(2000.0, 500.0), sigma=2e-6)
    wrong = track.value + normal_gravity(latitude) - normal_gravity(track.latitude)
    prior = Uncertainty(position=1500.0)
    for reduction, good in (("latitude", True), ("none", False)):
        reduced = replace(track, value=wrong, reduction=reduction)
        match = match_track(reduced, DISTURBANCE, Matcher(batch_length=60, **EXACT), prior)[0]
        error = errors_of([match], latitude, longitude)[0]
        consistent = match.fix.published and nees_per_axis(error, match.fix.covariance) < 6.9
        assert consistent == good


def test_readings_that_may_lie_off_the_map_do_not_move_the_fix():
    """The true track starts 1 km beyond the edge of the map, and the recorded one 1 km within, so
    all readings seem to be on the map."""
    wider = replace(field_map_of(wavy, half=50e3), quantity="disturbance")
    way = {"start": (-41e3, -25e3), "step": (225.0, 225.0), "seed": 3}
    track, *truth = made_track(wider, 80, (2000.0, 0.0), **way)
    prior = Uncertainty(position=1500.0)
    (batch,) = batches_of(track, prior, batch_length=80)
    kept = np.isfinite(batch.reading)
    assert not kept[:7].any()
    assert kept[-53:].all()
    match = match_track(track, DISTURBANCE, Matcher(batch_length=80), prior)[0]
    assert match.fix.published, match.fix.reason
    assert nees_per_axis(errors_of([match], *truth)[0], match.fix.covariance) < 6.9
