"""Batches of a recorded track: where they end, what they hold, and what is left out at the edge of
the map."""

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from helpers.tracks import field_of, made_track
from isogal.earth.ellipsoid import metres_per_radian
from isogal.scenario import Matcher
from isogal.tracks.bank import POSSIBLE, SURE, on_map
from isogal.tracks.fields import TrackField, batch_ends

DISTURBANCE = field_of("disturbance")
PRIOR = np.diag([800.0**2, 800.0**2, 0.1**2, 0.1**2])


@pytest.mark.parametrize(
    ("count", "length", "stride", "ends"),
    [
        (60, 30, None, [30, 60]),
        (65, 30, None, [30, 60, 65]),
        (63, 30, None, [30, 60]),  # FEWEST_IN_BATCH is 4
        (10, 30, None, [10]),
        (3, 30, None, [3]),
        (60, 30, 10, [30, 40, 50, 60]),
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
    field_map = field_map_of(wavy)
    track, _, _ = made_track(field_map, start=(30e3, 0.0), step=(150.0, 0.0))
    prior = np.diag([sigma**2, sigma**2, 1e-12, 1e-12])
    batch = TrackField("gravity", track, field_map).batch(slice(0, 60), 60, np.zeros(4), prior)
    found = np.isfinite(on_map(batch, field_map, least).reading)
    assert found.sum() == pytest.approx(kept, abs=1)
    assert found[: kept - 1].all()


def test_a_batch_is_moved_by_the_error_known_so_far():
    track, _, _ = made_track(DISTURBANCE, reduction="latitude")
    jacobian = track.jacobian("disturbance")
    error = np.array([300.0, -200.0, 0.5, -0.25])
    rows = slice(5, 35)
    batch = TrackField("gravity", track, DISTURBANCE).batch(rows, 20, error, PRIOR)
    assert (len(batch), batch.new) == (30, 20)
    elapsed = track.time[rows] - track.time[34]
    moved = np.stack([300.0 + 0.5 * elapsed, -200.0 - 0.25 * elapsed], axis=1)
    north, east = metres_per_radian(track.latitude[rows])
    found = (track.latitude[rows] - batch.latitude) * north
    np.testing.assert_allclose(found, moved[:, 0], rtol=1e-6)
    found = (track.longitude[rows] - batch.longitude) * east
    np.testing.assert_allclose(found, moved[:, 1], rtol=1e-6)
    np.testing.assert_allclose(batch.transition @ error, moved)
    np.testing.assert_allclose(batch.velocity, track.velocity[rows] - error[2:])
    expected = track.value[rows] - jacobian[rows, 0] * moved[:, 0]
    np.testing.assert_allclose(batch.reading, expected, rtol=1e-12)
