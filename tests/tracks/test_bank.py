"""Recorded tracks by the bank's models: what is told, the map beyond its edge, error
bars."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import make_batch
from helpers.tracks import field_of, made_track
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.consistency import chi_square_interval, nees_per_axis
from isogal.maps.displacement import SIZE
from isogal.matching.interfaces import SecondaryBatch
from isogal.matching.pmht.states import States
from isogal.scenario import Matcher
from isogal.seeds import generator
from isogal.tracks.continued_map import continued
from isogal.tracks.evidence import Seen
from isogal.tracks.matching import Uncertainty, match_track
from isogal.tracks.models import (
    EVEN,
    LENGTHS,
    pattern_of,
    track_models,
)
from isogal.tracks.widening import displacement

DISTURBANCE = field_of("disturbance")
EASTWARD, _ = make_batch(DISTURBANCE, velocity=(0.0, 60.0))
SETTINGS = Matcher(batch_length=40)


def seen_of(batch, field_map=DISTURBANCE, **said):
    """The readings of a batch, with the models of what is told."""
    return Seen.of(SecondaryBatch(0, batch, field_map), Matcher(**said), "")


def models(field_map=DISTURBANCE, **said):
    batch, _ = make_batch(field_map)
    return track_models(Matcher(**said), batch, field_map, States.of(batch, field_map))


def test_what_is_told_narrows_the_models():
    assert set(models().lengths) == set(LENGTHS)
    assert models(map_sigma=0.0, bias_sigma=0.0).sigma.tolist() == [0.0]
    keys = {"map_sigma": 3e-5, "map_correlation_length": 2e3, "bias_sigma": 0.0}
    told = models(**keys)
    best = int(np.argmax(told.log_prior))
    assert (told.sigma[best], told.length[best]) == (3e-5, 2e3)
    assert (pattern_of(told) == EVEN).all()
    assert len(models(**keys, options={"trust": 1.0}).sigma) == 1


def _shifts(field_map, count=40):
    track, _, _ = made_track(field_map, count, (300.0, -200.0), 1e-6)
    settings = Matcher(batch_length=count)
    return match_track(track, field_map, settings, Uncertainty(500.0))[0].shifts


def _gridded(sigma, ellipse=(4e6, 0.0, 4e6), length=2e3):
    """A map that says a 1-sigma, as of gridded readings, and over what area it holds together."""
    shape = DISTURBANCE.values.shape
    return replace(
        DISTURBANCE,
        sigma=np.full(shape, sigma),
        correlation_length=length,
        error_ellipses=np.broadcast_to(ellipse, (*shape, 3)),
    )


def test_a_gridded_map_that_knows_nothing_gives_no_fix():
    """Though its readings fit at one place alone, as is seen where it says a smaller error."""
    track, _, _ = made_track(DISTURBANCE, 40, (300.0, -200.0), 1e-6)
    shown = float(np.std(track.value))
    for share, given in ((0.25, True), (10.0, False)):
        fix = match_track(track, _gridded(share * shown), SETTINGS, Uncertainty(1000.0))[0].fix
        assert fix.published == given
        assert given or "its own 1-sigma" in fix.reason


def test_what_a_gridded_map_does_not_resolve_is_left_to_the_readings():
    field_map = _gridded(2e-5)
    whole = replace(field_map, sigma=np.hypot(field_map.sigma, 5e-5), unresolved=5e-5)
    expected, found = (seen_of(EASTWARD, one) for one in (field_map, whole))
    np.testing.assert_allclose(found.models.sigma, expected.models.sigma, rtol=1e-9)
    np.testing.assert_allclose(found.own_variance, expected.own_variance, rtol=1e-9)


def test_a_gridded_map_may_be_displaced():
    """An error of 2 mGal over 2 km, of a field of 10 mGal RMS; each is found within a factor."""
    gridded = _gridded(2e-5)
    assert not displacement(_shifts(DISTURBANCE)).any()
    short, long = _shifts(gridded), _shifts(gridded, 80)
    (north, skew), (_, east) = displacement(short)
    assert north == pytest.approx(east) and abs(skew) < 1e-6 * north
    assert SIZE * 1e3 * 0.02 < np.sqrt(north) < SIZE * 4e3 * 0.4
    # of one model, however long the track is
    for shifts in (short, long):
        (whole,) = shifts.seen
        seen = replace(whole, which=whole.which[:1], parts=whole.parts[:1])
        one = replace(shifts, seen=(seen,))
        error = seen.map_sigma[0] ** 2
        share = error / (error + seen.shown(one.likeliest))
        expected = (SIZE * seen.length[0]) ** 2 * share * np.eye(2)
        np.testing.assert_allclose(displacement(one), expected, rtol=1e-6, atol=1e-3)


def test_a_continued_map_is_the_map_where_there_is_one_and_doubtful_elsewhere():
    values = DISTURBANCE.values.copy()
    values[10:14, 20:30] = np.nan
    holed = replace(DISTURBANCE, values=values)
    longer = continued(holed, 5000.0)
    track, _, _ = made_track(DISTURBANCE)
    on_map = holed.value(track.latitude, track.longitude)
    inside = longer.field.value(track.latitude, track.longitude)
    np.testing.assert_allclose(inside, np.where(np.isnan(on_map), inside, on_map), rtol=1e-9)
    assert np.isfinite(longer.field.values).all()
    doubt = longer.doubt
    assert doubt.max() <= np.nanstd(values) * (1.0 + 1e-12)
    assert doubt[0, 0] > 0.0
    rim = (longer.field.values.shape[0] - values.shape[0]) // 2
    np.testing.assert_array_equal(doubt[rim:-rim, rim:-rim] > 0.0, np.isnan(values))
    # what the map says of its error goes along
    kriged = replace(holed, sigma=0.1 + 0 * values)
    np.testing.assert_array_equal(continued(kriged, 5000.0).field.sigma, 0.1)


def _match(run):
    random = generator(11, run, "track")
    error = random.normal(0.0, 500.0, 2)
    start = tuple(random.uniform(-15e3, 5e3, 2))
    track, latitude, longitude = made_track(DISTURBANCE, 40, error, 1e-5, run, start)
    # a map error that nobody tells, correlated over 2 km
    distance = np.arange(40) * float(np.hypot(*track.velocity[0])) * 10.0
    covariance = (3e-5) ** 2 * np.exp(-np.abs(distance[:, None] - distance) / 2000.0)
    wrong = np.linalg.cholesky(covariance) @ random.standard_normal(40)
    track = replace(track, value=track.value + wrong)
    match = match_track(track, DISTURBANCE, SETTINGS, Uncertainty(position=500.0))[0]
    fix = match.fix
    if not fix.published:
        return match, np.nan
    apart = horizontal_difference(fix.latitude, fix.longitude, latitude[-1], longitude[-1])
    return match, float(nees_per_axis(apart, fix.covariance))


def test_nothing_told_of_a_wrong_map_the_error_bars_are_honest():
    """4 tracks over a map that is 3 mGal wrong: the mean NEES is below the upper end of its
    99.9 % interval, and not absurdly small; sigma and length come out within a factor of two."""
    found = [_match(run) for run in range(4)]
    nees = np.array([value for _, value in found])
    nees = nees[np.isfinite(nees)]
    assert nees.size >= 3
    assert 0.2 < nees.mean() < chi_square_interval(nees.size, confidence=0.999)[1]
    sigma = [match.fix.diagnostics["map_sigma"] for match, _ in found]
    assert 1.5e-5 < np.median(sigma) < 6e-5


def test_a_spike_is_left_out():
    track, latitude, longitude = made_track(DISTURBANCE, 40, (300.0, 200.0), 1e-6)
    track.value[33] += 1e-2
    fix = match_track(track, DISTURBANCE, SETTINGS, Uncertainty(500.0))[0].fix
    assert fix.published
    assert fix.diagnostics["readings_left_out"] >= 1.0
    apart = horizontal_difference(fix.latitude, fix.longitude, latitude[-1], longitude[-1])
    assert np.hypot(*apart) < 100.0
