"""Readings of several fields, or of several channels, along one track."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from helpers.tracks import field_of, made_track
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.scenario import Matcher
from isogal.tracks.fields import TrackField
from isogal.tracks.matching import Uncertainty, match_fields

ERROR = (700.0, -500.0)
PRIOR = Uncertainty(position=800.0)
BATCH = Matcher(batch_length=40, map_sigma=1e-6, bias_sigma=0.0, options={"trust": 1.0})


def magnetic(name="magnetic", sigma=2.0):
    """A field that is not proportional to the disturbance, nT."""
    field_map = field_map_of(lambda north, east: 1e6 * wavy(-east + 7e3, north))
    field_map = replace(
        field_map, unit="nT", file_unit="nT", quantity="magnetic_anomaly", provenance="mag.nc"
    )
    track = made_track(field_map, 40, error=ERROR, sigma=sigma, seed=5)[0]
    return TrackField(name, track, field_map, BATCH.model_copy(update={"map_sigma": 1.0}))


def gravity(field_map=None, **settings):
    field_map = field_map or field_of("disturbance")
    track, latitude, longitude = made_track(field_map, 40, error=ERROR)
    field = TrackField("gravity", track, field_map, BATCH.model_copy(update=settings))
    return field, (latitude[-1], longitude[-1])


def apart(match, place):
    north, east = metres_per_radian(place[0])
    fix = match.fix
    return np.array([(fix.latitude - place[0]) * north, (fix.longitude - place[1]) * east])


def test_two_fields_are_as_good_as_their_information_together():
    first, place = gravity()
    second = magnetic()
    (both,) = match_fields([first, second], PRIOR)
    alone = [match_fields([one], PRIOR)[0] for one in (first, second)]
    together = np.linalg.inv(sum(np.linalg.inv(one.fix.covariance) for one in alone))
    ratio = np.sqrt(np.linalg.det(both.fix.covariance) / np.linalg.det(together))
    assert 0.6 < ratio < 1.6
    off = apart(both, place)
    assert off @ np.linalg.solve(both.fix.covariance, off) < 12.0
    numbers = both.fix.diagnostics
    assert numbers["map_sigma"] < 1e-5
    assert 0.0 < numbers["magnetic.map_sigma"] < 20.0


def test_what_one_field_leaves_open_another_decides():
    def repeating(north, east):
        return 2e-4 * np.sin(2 * np.pi * np.asarray(north) / 1500.0) + 2e-4 * np.sin(
            2 * np.pi * np.asarray(east) / 1500.0
        )

    first, place = gravity(field_map_of(repeating))
    (alone,) = match_fields([first], PRIOR)
    assert alone.fix.reason.startswith("ambiguous: 8 places fit, the best with probability ")
    (both,) = match_fields([first, magnetic(sigma=20.0)], PRIOR)
    assert both.fix.published
    assert np.hypot(*apart(both, place)) < 100.0


def test_a_field_without_readings_says_nothing():
    first, _ = gravity()
    second = magnetic()
    silent = replace(second, track=replace(second.track, value=np.full(len(second.track), np.nan)))
    (both,) = match_fields([first, silent], PRIOR)
    (alone,) = match_fields([first], PRIOR)
    assert both.fix.latitude == alone.fix.latitude
    assert both.fix.diagnostics == alone.fix.diagnostics


def test_fields_of_different_tracks_are_refused():
    first, _ = gravity()
    second = magnetic()
    late = replace(second, track=replace(second.track, time=second.track.time + 1.0))
    with pytest.raises(InputError, match="not at the times"):
        match_fields([first, late], PRIOR)
    with pytest.raises(InputError, match="names of their own"):
        match_fields([first, magnetic("gravity")], PRIOR)
