"""Recorded tracks: what is refused, whether a track belongs to a map, derivatives of the
reduction, means of stretches."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.tracks import field_of, made_track
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.maps.corridor import along_track
from isogal.sensors.gravimeter import GravityReduction
from isogal.sensors.magnetometer import intensity
from isogal.sensors.reduction import State
from isogal.tracks.averaging import averaged
from isogal.tracks.track import fit_to_map

DISTURBANCE = field_of("disturbance")


def changed(**changes):
    track, _, _ = made_track(DISTURBANCE)
    return replace(track, **changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"latitude": np.full(60, np.nan)}, "latitude of reading 1 is not a finite number"),
        ({"time": np.zeros(60)}, "time of reading 2 is not later .* times must increase"),
        ({"latitude": np.full(60, 2.0)}, "place of reading 1 is out of range"),
        ({"sigma": np.zeros(60)}, "sigma of reading 1 must be > 0"),
        ({"sigma": np.full(60, np.inf)}, "sigma of reading 1 must be > 0 and finite"),
        ({"sigma": 1e-5}, r"sigma must have shape \(60,\), has \(\)"),
        ({"value": np.zeros(20)}, r"value must have shape \(60,\), has \(20,\)"),
        ({"value": np.zeros((60, 1))}, r"value must have shape \(60,\), has \(60, 1\)"),
        ({"time": np.arange(60).astype("M8[ns]")}, "time must be numbers, is of type datetime64"),
        ({"reduction": "speed"}, "must be one of none, latitude, velocity"),
    ],
)
def test_wrong_numbers_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        changed(**changes)


class Labelled:
    """A column of a table as pandas has it, which is an array only when it is asked for one; left
    as it is, its arithmetic would pair rows by their labels."""

    def __init__(self, column) -> None:
        self.column = column

    def __array__(self, dtype=None, copy=None):
        return np.array(self.column, dtype)


def test_columns_may_be_lists_masked_or_labelled():
    track = changed()
    holed = np.ma.array(track.value, mask=np.arange(60) == 3, fill_value=-9999.0)
    same = changed(time=list(track.time), value=holed, sigma=Labelled(track.sigma))
    assert type(same.sigma) is type(same.time) is np.ndarray
    assert np.flatnonzero(np.isnan(same.value)).tolist() == [3]
    np.testing.assert_array_equal(same.time, track.time)


NAMES = ("time", "latitude", "longitude", "value", "sigma", "offset")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({name: getattr(changed(), name)[:2] for name in NAMES}, "at least 3 readings, has 2"),
        ({"latitude": changed().latitude + 0.1}, r"off the map disturbance.nc .* 0 of 60 readi"),
        ({"value": np.full(60, np.nan)}, "0 of 60 readings have a value, at least 3 are needed"),
    ],
    ids=["few", "off the map", "missing"],
)
def test_tracks_that_do_not_fit_the_map_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        fit_to_map(changed(**changes), DISTURBANCE)


def test_readings_where_the_map_is_empty_are_named():
    values = DISTURBANCE.values.copy()
    track, _, _ = made_track(DISTURBANCE)
    hole = np.searchsorted(DISTURBANCE.latitude, track.latitude[20])
    values[hole] = np.nan
    kept, off_map = fit_to_map(track, replace(DISTURBANCE, values=values))
    assert off_map[20]
    assert 1 <= off_map.sum() < 10
    assert kept is track  # elsewhere the map may have a value


@pytest.mark.parametrize(
    ("quantity", "factor", "unit"),
    [("disturbance", 1e5, "mGal"), ("magnetic_anomaly", 1e-9, "T")],
)
def test_readings_in_another_unit_are_refused_with_the_unit(quantity, factor, unit):
    field_map = field_of(quantity)
    track, _, _ = made_track(field_map, sigma=1e-9)
    fit_to_map(track, field_map)
    says = f"do not fit the {quantity} map .*they look like {unit}: give --track-unit '{unit}'"
    with pytest.raises(InputError, match=says):
        fit_to_map(replace(track, value=track.value * factor), field_map)


def test_gravity_against_a_disturbance_map_is_refused_unless_normal_gravity_is_the_offset():
    track, latitude, _ = made_track(DISTURBANCE)
    gamma = normal_gravity(latitude)
    gravity = replace(track, value=track.value + gamma)
    says = "they look like gravity: give normal gravity in the column offset"
    with pytest.raises(InputError, match=says):
        fit_to_map(gravity, DISTURBANCE)
    fit_to_map(replace(gravity, offset=gamma), DISTURBANCE)


def test_jacobian_of_each_reduction():
    track, _, _ = made_track(DISTURBANCE)
    np.testing.assert_allclose(track.velocity, np.tile([14.0, 17.0], (60, 1)), rtol=2e-3)
    assert not track.jacobian("disturbance").any()
    latitude = replace(track, reduction="latitude").jacobian("bouguer_anomaly")
    # normal gravity at a latitude 1 m too far south (in the south it grows to the south) is too
    # large, so the reading too small
    change = normal_gravity(track.latitude) - normal_gravity(track.latitude + 1.0 / 6.36e6)
    np.testing.assert_allclose(latitude[:, 0], change, rtol=2e-3)
    assert not latitude[:, 1:].any()
    velocity = replace(track, reduction="velocity").jacobian("gravity")
    at = State(track.latitude, track.longitude, 0.0, *track.velocity.T)
    expected = GravityReduction().jacobian(at)
    np.testing.assert_allclose(velocity, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("quantity", "reduction"),
    [("height", "velocity"), ("gravity", "latitude"), ("magnetic_anomaly", "velocity")],
)
def test_reductions_of_other_fields_are_refused(quantity, reduction):
    says = f"readings of {quantity} are not reduced with the track's {reduction}"
    with pytest.raises(InputError, match=says):
        changed(reduction=reduction).jacobian(quantity)


def test_jacobian_of_the_reduction_with_the_main_field():
    """nT/m, against differences over a kilometre."""
    track = changed(reduction="main-field")
    jacobian = track.jacobian("magnetic_anomaly")
    at = np.degrees([track.latitude, track.longitude])
    steps = np.degrees(500.0 / np.array(metres_per_radian(track.latitude)))
    for axis in (0, 1):
        step = np.zeros_like(at)
        step[axis] = steps[axis]
        south, north = (intensity(*(at + sign * step), 0.0, 2025.0) for sign in (-1, 1))
        np.testing.assert_allclose(jacobian[:, axis], (south - north) / 1000.0, atol=2e-5)
    assert np.abs(jacobian[:, 0]).min() > 1e-3
    assert not jacobian[:, 2:].any()


def test_constant_readings_are_not_taken_for_another_unit():
    track, _, _ = made_track(DISTURBANCE, sigma=1e-9)
    flat = replace(track, value=np.full(60, float(np.median(track.value))))
    fit_to_map(flat, DISTURBANCE)


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
