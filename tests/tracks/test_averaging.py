"""Dense tracks averaged over stretches."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.tracks import field_of, made_track
from isogal.maps.corridor import along_track
from isogal.tracks.averaging import averaged


def test_readings_of_a_stretch_become_their_mean():
    track, _, _ = made_track(field_of("disturbance"), count=60, sigma=2e-5)
    step = float(np.median(np.diff(along_track(track.latitude, track.longitude))))
    found = averaged(track, 3.0 * step + 1.0)
    assert 18 <= len(found) <= 22
    np.testing.assert_allclose(found.value.mean(), track.value.mean(), atol=1e-5)
    assert found.sigma.min() == pytest.approx(2e-5 / np.sqrt(4.0), rel=0.16)
    assert (np.diff(found.time) > 0.0).all()


def test_missing_readings_do_not_count():
    track, _, _ = made_track(field_of("disturbance"), count=60)
    value = np.where(np.arange(60) % 2 == 0, np.nan, track.value)
    found = averaged(replace(track, value=value), 1000.0)
    assert np.isfinite(found.value).all()
