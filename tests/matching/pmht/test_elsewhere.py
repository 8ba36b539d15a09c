"""The quick look whether readings fit much better somewhere else."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.elsewhere import Look, evidence_at, look_elsewhere
from isogal.matching.pmht.last_hour import LastHour, LostError, Seen, Track
from isogal.matching.pmht.map_error import MapErrorEstimate

AWAY = np.array([6000.0, -8000.0])


def batches(field_map, error, seed, scans=150, wrong=0.0, sigma=1e-5):
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
        sigma=sigma,
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


def track(new, still=False):
    """Readings of a navigator whose velocity error stays what it is, 10 s after 10 s."""
    count = sum(len(one.time) for one in new)
    since = 10.0 * (np.arange(count) - 0.5 * (count - 1))
    position = np.zeros((count, 2, 7))
    position[:, 0, 0] = position[:, 1, 1] = 1.0
    if not still:
        position[:, 0, 2] = position[:, 1, 3] = since
    rows, first = [], 0
    for one in new:
        part = slice(first, first + len(one.time))
        first += len(one.time)
        nothing = np.zeros((len(one.time), 7))
        rows.append((one, position[part], nothing, nothing[:, :0]))
    return Track.of(rows)


def hour(field_map, new, far=None, map_error=None):
    """What a look is given of a navigator with a velocity that is known as its batches say."""
    prior = np.zeros((7, 7))
    prior[:4, :4] = new[0].prior
    half = 5.0 * (sum(len(one.time) for one in new) - 1)
    back = np.eye(7)
    back[0, 2] = back[1, 3] = -half
    root = np.zeros((5, 5))
    root[:2, :2] = np.linalg.cholesky(prior[2:4, 2:4])
    lost = LostError(np.zeros((5, 2)), root, back, np.linalg.inv(back))
    map_error = map_error or MapErrorEstimate.unknown(new[0], field_map).coarse_prior
    seen = Seen(track(new, still=True), track(far or new), field_map, map_error)
    return LastHour((seen,), new[-1].prior[:2, :2], lost)


def look(field_map, new):
    return look_elsewhere(hour(field_map, new))


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


def test_few_readings_or_no_map_say_nothing(rough_map):
    new = batches(rough_map, AWAY, 0)
    assert look(rough_map, new[:3]) is None
    off = [replace(one, latitude=one.latitude + 0.1) for one in new]
    assert look(rough_map, off) is None


def test_a_field_that_says_little_is_looked_at_with_one_that_says_much(rough_map):
    """Readings of a smooth field fit everywhere; those of a rough one where they were taken."""
    smooth = field_map_of(lambda north, east: 1e-10 * (north + 0.5 * east))
    one, two = (hour(field_map, batches(field_map, AWAY, 0)) for field_map in (smooth, rough_map))
    alone = look_elsewhere(one)
    assert alone is None or not alone.says_lost
    found = look_elsewhere(replace(one, seen=one.seen + two.seen))
    assert found.says_lost
    np.testing.assert_allclose(found.place, AWAY, atol=600.0)


def test_what_the_navigators_velocity_puts_into_readings_is_no_reason_to_doubt_its_place(
    rough_map,
):
    """The Eötvös effect of a velocity that swings by 0.2 m/s is 2 mGal, twenty times the noise."""
    new = batches(rough_map, (0.0, 0.0), 0, sigma=1e-6)
    swing = 2e-5 * np.sin(np.linspace(0.0, 2.0, 150))
    new = [
        replace(one, reading=one.reading + part)
        for one, part in zip(new, swing.reshape(5, 30), strict=True)
    ]
    plain = hour(rough_map, new)
    (seen,) = plain.seen
    knows = [replace(track, root=swing[:, None]) for track in (seen.aided, seen.unaided)]
    known = replace(seen, aided=knows[0], unaided=knows[1])
    found = look_elsewhere(replace(plain, seen=(known,)))
    assert found is None or not found.says_lost
    place = AWAY, 100.0**2 * np.eye(2)
    assert evidence_at(replace(plain, seen=(known,)), place) < evidence_at(plain, place) - 10.0


@pytest.mark.filterwarnings("error")
def test_a_track_without_fixes_that_is_off_the_map_says_nothing(rough_map):
    new = batches(rough_map, AWAY, 0)
    far = [replace(one, latitude=one.latitude + 0.1) for one in new]
    assert look_elsewhere(hour(rough_map, new, far)) is None


def test_groups_of_readings_are_means_with_less_noise(rough_map):
    new = batches(rough_map, AWAY, 0)
    new[1] = replace(new[1], reading=np.where(np.arange(30) == 3, np.nan, new[1].reading))
    readings = track(new)
    assert len(readings.level) == 149
    groups = readings.grouped(40)
    assert len(groups.level) == 37
    np.testing.assert_allclose(groups.level[-1], readings.level[-4:].mean())
    np.testing.assert_allclose(groups.sigma, readings.sigma[0] / 2.0)


@pytest.mark.parametrize(("wrong", "lost"), [(1e-4, False), (0.0, True)])
def test_told_to_be_exact_a_bad_map_is_not_a_lost_navigator(rough_map, wrong, lost):
    """With a sigma that is told and wrong a place far away would win by chance."""
    for seed in range(4):
        one = batches(rough_map, AWAY if lost else (60.0, -40.0), seed, scans=60, wrong=wrong)
        unknown = MapErrorEstimate.unknown(one[0], rough_map).coarse_prior
        prior = unknown.or_rather(0.0, CONSTANTS.told_probability)
        assert np.isclose(np.exp(prior.log_weight).sum(), 1.0)
        found = look_elsewhere(hour(rough_map, one, map_error=prior), least=2)
        says = found is not None and found.log_evidence > CONSTANTS.lost_on_any_map_log_evidence
        assert says == lost


@pytest.mark.parametrize(("log_evidence", "readings"), [(3.0, 15), (-3.0, 60), (-12.0, 180)])
def test_the_less_likely_lost_the_later_the_next_look(log_evidence, readings) -> None:
    assert Look(log_evidence, np.zeros(2), np.eye(2), 0.5).readings_to_next == readings
