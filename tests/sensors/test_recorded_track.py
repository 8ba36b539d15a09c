"""The true route along a recorded track."""

import os

import numpy as np
import pytest

from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.inertial.inverse import NO_COURSE
from isogal.inertial.rotations import matrix, to_angles
from isogal.scenario import validate_scenario
from isogal.sensors.recorded_track import read_positions
from isogal.sensors.trajectory import build_trajectory, first_place

LATITUDE, LONGITUDE = 47.0, 8.0
NORTH, EAST = (float(x) for x in metres_per_radian(np.radians(LATITUDE)))
SPEED, RADIUS, SECONDS = 10.0, 300.0, 10.0
"""m/s, m, and s in which it gains its speed."""


def circle_after_rest(rest=60.0, turn=120.0):
    """Times (N,), s, north and east (N,), m, of a vehicle at rest and then on a circle."""
    time = np.arange(0.0, rest + turn)
    since = np.maximum(time - rest, 0.0)
    way = np.where(since < SECONDS, 0.5 * since**2 / SECONDS, since - 0.5 * SECONDS)
    angle = SPEED / RADIUS * way
    return time, RADIUS * np.sin(angle), RADIUS * (1.0 - np.cos(angle))


def write(path, time, north, east, **more):
    latitude = LATITUDE + np.degrees(north / NORTH)
    longitude = LONGITUDE + np.degrees(east / EAST)
    columns = {"time": time, "latitude": latitude, "longitude": longitude} | more
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, "%.12g", ",", header=",".join(columns), comments="")
    return path


def scenario(path, **changes):
    return validate_scenario({"route": {"track": str(path)}, **changes})


def test_a_vehicle_is_at_rest_and_turns_as_its_positions_say(tmp_path):
    time, north, east = circle_after_rest()
    noise = np.random.default_rng(1).normal(0.0, 0.5, (2, len(time)))
    found = build_trajectory(
        scenario(write(tmp_path / "a.csv", 1e9 + time, north + noise[0], east + noise[1]))
    )
    assert len(found) == len(time) - 1
    assert found.begin == 1e9
    at_rest = slice(2, 55)
    assert np.abs(found.velocity[at_rest]).max() < 1e-9
    assert np.abs(found.angular_rate[at_rest, 2]).max() < 0.1
    turning = slice(75, 170)
    speed = np.hypot(*found.velocity[turning, :2].T)
    assert speed.mean() == pytest.approx(SPEED, abs=0.1)
    assert speed.std() < 0.5  # differences of the positions themselves: 0.7
    np.testing.assert_allclose(found.angular_rate[turning, 2].mean(), SPEED / RADIUS, rtol=0.05)
    np.testing.assert_allclose(found.specific_force[turning, 1].mean(), 0.333, atol=0.02)
    off = np.hypot(
        (found.latitude - np.radians(LATITUDE)) * NORTH - north,
        (found.longitude - np.radians(LONGITUDE)) * EAST - east,
    )
    assert np.quantile(off, 0.95) < 1.0
    assert off.max() < 4.0 * 0.5 * np.sqrt(2.0)  # where it moves off, within the scatter
    course = np.arctan2(found.velocity[:, 1], found.velocity[:, 0])
    heading = np.array([to_angles(matrix(row))[2] for row in found.attitude])
    moves = np.hypot(*found.velocity[:, :2].T) > 10.0 * NO_COURSE
    np.testing.assert_allclose(np.cos(course - heading)[moves], 1.0, atol=1e-4)


def test_duration_cuts_a_track_and_heights_count_where_a_sensor_measures_them(tmp_path):
    time, north, east = circle_after_rest()
    path = write(tmp_path / "a.csv", time, north, east, height=200.0 + 0.5 * time)
    cut = validate_scenario({"route": {"track": str(path), "duration": 50.0, "height": 30.0}})
    found = build_trajectory(cut)
    assert found.time[-1] == 50.0
    assert (found.height == 30.0).all()
    climbs = build_trajectory(scenario(path, height={"source": "barometer"}))
    np.testing.assert_allclose(climbs.height, 200.0 + 0.5 * climbs.time, atol=0.05)
    np.testing.assert_allclose(climbs.velocity[:, 2], -0.5, atol=0.01)
    assert first_place(cut.route) == pytest.approx((np.radians(LATITUDE), np.radians(LONGITUDE)))


def test_lines_and_times_of_a_netcdf_file(tmp_path):
    import netCDF4

    time, north, east = circle_after_rest()
    path = tmp_path / "a.nc"
    with netCDF4.Dataset(path, "w") as dataset:
        dataset.createDimension("row", 2 * len(time))
        for name, values in {
            "time": np.tile(time / 60.0, 2),
            "lat": LATITUDE + np.degrees(np.tile(north, 2) / NORTH),
            "lon": LONGITUDE + np.degrees(np.tile(east, 2) / EAST),
            "line": np.repeat([7, 8], len(time)),
        }.items():
            dataset.createVariable(name, values.dtype, ("row",))[:] = values
        dataset["time"].units = "minutes since 2000-07-16 12:35:00"
    of_line = {"route": {"track": str(path), "track_line": "8"}}
    found = build_trajectory(validate_scenario(of_line))
    assert found.begin == 963750900.0  # date -u -d '2000-07-16 12:35' +%s
    assert len(found) == len(time) - 1
    with pytest.raises(InputError, match=r"has 2 lines; route.track_line must be one of 7, 8"):
        build_trajectory(scenario(path))


def test_a_track_that_jumps_is_refused_by_line(tmp_path):
    time, north, east = circle_after_rest()
    east[10] += 80e3
    path = write(tmp_path / "a.csv", time, north, east)
    with pytest.raises(InputError, match=r"in line 12 are .* km from those 1 s before"):
        build_trajectory(scenario(path))


def test_a_track_over_a_pole_is_refused_by_line(tmp_path):
    rows = (f"{k},{89.9 + 0.02 * k},10.0" for k in range(6))
    path = tmp_path / "track.csv"
    path.write_text("\n".join(["time,latitude,longitude", *rows]))
    with pytest.raises(InputError, match=r"latitude in line 5 must be within 89.95 deg"):
        read_positions(str(path))


@pytest.mark.parametrize("key", ["start", "waypoints", "at_rest"])
def test_keys_of_other_routes_say_nothing_beside_a_track(key):
    value = {"start": [1.0, 2.0], "at_rest": 60.0}.get(key, [[1, 2, 3], [2, 3, 4]])
    with pytest.raises(InputError, match=f"{key}: says nothing beside track"):
        validate_scenario({"route": {"track": "a.csv", key: value}})


def test_a_file_that_has_changed_is_read_anew(tmp_path):
    """In a notebook the process stays, and the file does not."""
    time, north, east = circle_after_rest()
    of_file = scenario(write(tmp_path / "track.csv", time, north, east))
    before = build_trajectory(of_file), first_place(of_file.route)
    write(tmp_path / "track.csv", time, north + 5000.0, east)
    os.utime(tmp_path / "track.csv", ns=(1, 1))  # however coarse the file system's clock is
    after = build_trajectory(of_file), first_place(of_file.route)
    assert (after[0].latitude[0] - before[0].latitude[0]) * NORTH == pytest.approx(5000.0, abs=1.0)
    assert (after[1][0] - before[1][0]) * NORTH == pytest.approx(5000.0, abs=1.0)
