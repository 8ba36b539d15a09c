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
from isogal.tracks.matching import Uncertainty, match_track

DISTURBANCE = field_of("disturbance")
PRIOR = Uncertainty(position=800.0)
EXACT = {"map_sigma": 0.0, "bias_sigma": 0.0}
"""Told: nothing but the readings' white noise."""


def errors_of(matches, latitude, longitude):
    """(B, 2) north and east errors of the fixes, m; NaN where there is none."""
    ends = [match.rows.stop - 1 for match in matches]
    found = np.array(
        [[m.fix.latitude, m.fix.longitude] if m.fix.published else [np.nan] * 2 for m in matches]
    )
    return horizontal_difference(found[:, 0], found[:, 1], latitude[ends], longitude[ends])


class Recorder:
    """A matcher that keeps its batches and gives no fix."""

    name = "recorder"

    def __init__(self, context=0):
        self.context, self.batches = context, []

    def match(self, batch, field_map, memory):
        self.batches.append(batch)
        return declined(batch, "not matched"), None


def test_the_same_field_in_another_unit_gives_the_same_fixes():
    count, error = 30, (300.0, 200.0)
    track, _, _ = made_track(DISTURBANCE, count, error)
    gravity = match_track(track, DISTURBANCE, Matcher(), PRIOR)
    height = field_of("height")
    factor, offset = FIELDS["height"][1:]
    scaled, _, _ = made_track(height, count, error, sigma=1e-5 * factor)
    other = match_track(scaled, height, Matcher(), PRIOR)
    assert offset > 0.0
    for a, b in zip(gravity, other, strict=True):
        np.testing.assert_allclose(a.fix.covariance, b.fix.covariance, rtol=1e-4)
        assert horizontal_difference(
            a.fix.latitude, a.fix.longitude, b.fix.latitude, b.fix.longitude
        ) == pytest.approx([0.0, 0.0], abs=0.1)


def test_fixes_are_consistent_with_their_covariance():
    """Position errors drawn from the prior, 24 tracks of one batch: the mean NEES lies in its
    99.9 % interval."""
    nees = []
    for run in range(24):
        random = generator(7, run, "track")
        track, latitude, longitude = made_track(
            DISTURBANCE,
            count=20,
            error=random.normal(0.0, 400.0, 2),
            sigma=2e-5,
            seed=run,
            start=tuple(random.uniform(-15e3, 5e3, 2)),
        )
        matches = match_track(
            track, DISTURBANCE, Matcher(batch_length=20, **EXACT), Uncertainty(position=400.0)
        )
        if matches[0].fix.published:
            error = errors_of(matches, latitude, longitude)[0]
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


def test_without_fixes_all_batches_start_from_the_same_prior():
    track, _, _ = made_track(DISTURBANCE, error=(350.0, -250.0))
    settings = Matcher(batch_length=20)
    for chained in (False, True):
        recorder = Recorder()
        match_track(track, DISTURBANCE, settings, PRIOR, chained=chained, matcher=recorder)
        for batch in recorder.batches:
            np.testing.assert_allclose(np.diag(batch.prior)[:2], 800.0**2)
            np.testing.assert_allclose(
                batch.latitude, track.latitude[np.searchsorted(track.time, batch.time)]
            )


def test_velocity_error_and_walk_widen_the_prior_between_chained_batches():
    track, _, _ = made_track(DISTURBANCE)
    recorder = Recorder()
    uncertainty = Uncertainty(position=100.0, velocity=0.5, walk=3000.0)
    match_track(
        track, DISTURBANCE, Matcher(batch_length=20), uncertainty, chained=True, matcher=recorder
    )
    expected = [
        100.0**2 + (0.5 * 200.0 * k) ** 2 + 3000.0**2 * 200.0 * k / 3600.0 for k in range(3)
    ]
    np.testing.assert_allclose([batch.prior[0, 0] for batch in recorder.batches], expected)
    np.testing.assert_allclose(
        [batch.prior[0, 2] for batch in recorder.batches], [0.5**2 * 200.0 * k for k in range(3)]
    )


def test_each_reading_is_new_in_one_batch_and_context_comes_before():
    track, _, _ = made_track(DISTURBANCE, count=64)
    for stride, context in ((None, 0), (None, 15), (10, 5)):
        recorder = Recorder(context)
        match_track(
            track, DISTURBANCE, Matcher(batch_length=30, stride=stride), PRIOR, matcher=recorder
        )
        seen = np.concatenate([batch.time[-batch.new :] for batch in recorder.batches])
        np.testing.assert_array_equal(seen, track.time)
        for batch in recorder.batches[1:-1]:
            assert len(batch) == min(
                30 + context, int(np.searchsorted(track.time, batch.time[-1])) + 1
            )


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
    track, latitude, longitude = made_track(
        wider, count=80, error=(2000.0, 0.0), start=(-41e3, -25e3), step=(225.0, 225.0), seed=3
    )
    prior = Uncertainty(position=1500.0)
    recorder = Recorder()
    settings = Matcher(batch_length=80)
    match_track(track, DISTURBANCE, settings, prior, matcher=recorder)
    kept = np.isfinite(recorder.batches[0].reading)
    assert not kept[:7].any()
    assert kept[-53:].all()
    match = match_track(track, DISTURBANCE, settings, prior)[0]
    assert match.fix.published, match.fix.reason
    assert nees_per_axis(errors_of([match], latitude, longitude)[0], match.fix.covariance) < 6.9


@pytest.mark.parametrize(
    "keys",
    [
        {"position": 0.0},
        {"position": 1e-4},
        {"position": np.inf},
        {"velocity": -1.0},
        {"velocity": 2e3},
        {"walk": np.nan},
    ],
)
def test_uncertainties_out_of_range_are_refused(keys):
    with pytest.raises(InputError, match="1-sigma of the track's"):
        Uncertainty(**keys)
