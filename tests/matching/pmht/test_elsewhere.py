"""The quick look whether readings fit much better somewhere else."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import make_batch
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.elsewhere import Track, look_elsewhere
from isogal.matching.pmht.map_error import MapErrorEstimate

AWAY = np.array([6000.0, -8000.0])


def batches(field_map, error, seed, scans=150, wrong=0.0):
    """Thirty readings each of a slow track over the middle of the map, with a map error of so
    many m/s² over 4 km."""
    made = make_batch(
        field_map,
        (*error, 0.0, 0.0),
        scans,
        start=(-6000.0, -7000.0),
        velocity=(8.0, 9.0),
        prior_sigma=(100.0, 0.05),
        seed=seed,
    )[0]
    along = 10.0 * np.hypot(8.0, 9.0) * np.arange(scans)
    shape = np.exp(-np.abs(along[:, None] - along) / 4000.0)
    drawn = np.linalg.cholesky(shape) @ np.random.default_rng(seed).normal(size=scans)
    made = replace(made, reading=made.reading + wrong * drawn)
    whole = [replace(made.part(k), new=30) for k in range(0, scans, 30)]
    return [
        replace(
            one,
            **{
                name: getattr(one, name)[:30]
                for name in ("time", "latitude", "longitude", "reading", "offset", "sigma")
            },
        )
        for one in whole
    ]


def look(field_map, new):
    prior = MapErrorEstimate.unknown(new[0], field_map).coarse_prior
    return look_elsewhere(new, new, field_map, prior)


@pytest.mark.parametrize("wrong", [0.0, 2e-5])
def test_a_navigator_that_is_lost_is_seen_where_it_is(rough_map, wrong):
    for seed in range(4):
        found = look(rough_map, batches(rough_map, AWAY, seed, wrong=wrong))
        assert found.says_lost
        np.testing.assert_allclose(found.place, AWAY, atol=600.0)
        apart = found.place - AWAY
        assert apart @ np.linalg.solve(found.covariance, apart) < 9.0


@pytest.mark.parametrize("wrong", [0.0, 2e-5, 8e-5])
def test_one_that_is_not_is_left_alone(rough_map, wrong):
    """Poor map or good: no place elsewhere is worth a search."""
    for seed in range(8):
        error = np.random.default_rng(seed).normal(0.0, 80.0, 2)
        found = look(rough_map, batches(rough_map, error, seed, wrong=wrong))
        assert found is None or found.log_evidence < 1.0


def test_a_drift_on_the_way_is_allowed_for(rough_map):
    """1000 m in the time of the track, of a velocity that is known to 0.5 m/s; the place is that
    of the first reading."""
    drift = np.array([0.6, -0.3])
    moved = []
    for k, one in enumerate(batches(rough_map, AWAY, 0)):
        since = 300.0 * k + 10.0 * np.arange(30)
        shifted = batches(rough_map, AWAY, 0)[k]
        away = since[:, None] * drift / 6.371e6
        moved.append(
            replace(
                one,
                latitude=shifted.latitude + away[:, 0],
                longitude=shifted.longitude + away[:, 1] / np.cos(shifted.latitude),
                prior=np.diag([1e4, 1e4, 0.25, 0.25]),
            )
        )
    found = look(rough_map, moved)
    assert found.says_lost
    np.testing.assert_allclose(found.place, AWAY, atol=900.0)


def test_few_readings_several_channels_or_no_map_say_nothing(rough_map):
    new = batches(rough_map, AWAY, 0)
    assert look(rough_map, new[:3]) is None
    channels = [replace(one, channel=np.zeros(len(one.time), dtype=int)) for one in new]
    assert look(rough_map, channels) is None
    off = [replace(one, latitude=one.latitude + 0.1) for one in new]
    assert look(rough_map, off) is None


@pytest.mark.filterwarnings("error")
def test_a_track_without_fixes_that_is_off_the_map_says_nothing(rough_map):
    new = batches(rough_map, AWAY, 0)
    far = [replace(one, latitude=one.latitude + 0.1) for one in new]
    prior = MapErrorEstimate.unknown(new[0], rough_map).coarse_prior
    assert look_elsewhere(new, far, rough_map, prior) is None


def test_groups_of_readings_are_means_with_less_noise(rough_map):
    new = batches(rough_map, AWAY, 0)
    new[1] = replace(new[1], reading=np.where(np.arange(30) == 3, np.nan, new[1].reading))
    track = Track.of(new)
    assert len(track.level) == 149
    groups = track.grouped(40)
    assert len(groups.level) == 37
    np.testing.assert_allclose(groups.level[-1], track.level[-4:].mean())
    np.testing.assert_allclose(groups.sigma, track.sigma[0] / 2.0)


@pytest.mark.parametrize(("wrong", "lost"), [(1e-4, False), (0.0, True)])
def test_told_to_be_exact_a_bad_map_is_not_a_lost_navigator(rough_map, wrong, lost):
    """With a sigma that is told and wrong a place far away would win by chance."""
    for seed in range(4):
        one = batches(rough_map, AWAY if lost else (60.0, -40.0), seed, scans=60, wrong=wrong)
        unknown = MapErrorEstimate.unknown(one[0], rough_map).coarse_prior
        prior = unknown.or_rather(0.0, CONSTANTS.told_probability)
        assert np.isclose(np.exp(prior.log_weight).sum(), 1.0)
        found = look_elsewhere(one, one, rough_map, prior, least=2)
        says = found is not None and found.log_evidence > CONSTANTS.lost_on_any_map_log_evidence
        assert says == lost
