"""Readings of several fields, or of several channels, along one track; where batches end, what
they hold, and what is left out at the edge of the map."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from helpers.tracks import field_of, made_track
from isogal.earth.frames import horizontal_difference
from isogal.errors import InputError
from isogal.scenario import Matcher
from isogal.tracks.evidence import POSSIBLE, SURE, on_map
from isogal.tracks.fields import TrackField, batch_ends
from isogal.tracks.matching import Uncertainty, match_fields

DISTURBANCE = field_of("disturbance")
ERROR = (700.0, -500.0)
PRIOR = Uncertainty(position=800.0)
DRIFTING = Uncertainty(position=800.0, velocity=0.1)
BATCH = Matcher(batch_length=40, map_sigma=1e-6, bias_sigma=0.0, options={"trust": 1.0})


def magnetic(name="magnetic", sigma=2.0):
    """A field that is not proportional to the disturbance, nT."""
    waves = field_map_of(lambda north, east: 1e6 * wavy(-east + 7e3, north))
    field_map = replace(waves, unit="nT", file_unit="nT", quantity="magnetic_anomaly")
    track = made_track(field_map, 40, error=ERROR, sigma=sigma, seed=5)[0]
    return TrackField(name, track, field_map, BATCH.model_copy(update={"map_sigma": 1.0}))


def gravity(field_map=DISTURBANCE):
    track, latitude, longitude = made_track(field_map, 40, error=ERROR)
    return TrackField("gravity", track, field_map, BATCH), (latitude[-1], longitude[-1])


def apart(match, place):
    return np.array(horizontal_difference(match.fix.latitude, match.fix.longitude, *place))


@pytest.mark.parametrize("prior", [PRIOR, DRIFTING], ids=["rigid", "drifting"])
def test_two_fields_are_as_good_as_their_information_together(prior):
    first, place = gravity()
    second = magnetic()
    (both,) = match_fields([first, second], prior)
    alone = [match_fields([one], prior)[0] for one in (first, second)]
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
        return 2e-4 * (np.sin(2 * np.pi * north / 1500.0) + np.sin(2 * np.pi * east / 1500.0))

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
    (both,), (alone,) = (match_fields(fields, PRIOR) for fields in ([first, silent], [first]))
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


@pytest.mark.parametrize(
    ("count", "length", "stride", "ends"),
    [
        (65, 30, None, [30, 60, 65]),
        (63, 30, None, [30, 60]),  # FEWEST_IN_BATCH is 4
        (3, 30, None, [3]),
        (64, 30, 10, [30, 40, 50, 60, 64]),
    ],
)
def test_ends_of_batches(count, length, stride, ends):
    assert batch_ends(count, Matcher(batch_length=length, stride=stride)) == ends


@pytest.mark.parametrize(
    ("sigma", "least", "kept"),
    [(100.0, SURE, 60), (1800.0, SURE, 47), (50e3, SURE, 60), (1800.0, POSSIBLE, 60)],
)
def test_readings_near_the_edge_of_the_map_are_left_out(sigma, least, kept):
    """The track ends 1 km from the northern edge. Readings within 1.64 1-sigmas of it are left out
    if half of them remain; of a map that is continued none."""
    track, _, _ = made_track(DISTURBANCE, start=(30e3, 0.0), step=(150.0, 0.0))
    prior = np.diag([sigma**2, sigma**2, 1e-12, 1e-12])
    batch = TrackField("gravity", track, DISTURBANCE).batch(slice(0, 60), 60, np.zeros(4), prior)
    found = np.isfinite(on_map(batch, DISTURBANCE, least).reading)
    assert found.sum() == pytest.approx(kept, abs=1)
    assert found[: kept - 1].all()
