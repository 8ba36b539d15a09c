"""Recorded readings in place of simulated ones."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from isogal.errors import InputError
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.fields.measured import measured_field
from isogal.fields.recorded_readings import recorded_scans
from isogal.fields.simulator import ReadingSimulator
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.scenario import Readings, validate_scenario
from isogal.sensors.reduction import State
from isogal.sensors.trajectory import build_trajectory

MGAL = 1e-5
BEGIN = 1e9
EVERY_MINUTE = BEGIN + 60.0 * np.arange(11.0)


def write(path, columns):
    rows = [",".join(columns)]
    rows += [",".join(f"{x:.16g}" if np.isfinite(x) else "" for x in row)
             for row in zip(*columns.values(), strict=True)]  # fmt: skip
    path.write_text("\n".join(rows))
    return path


def scans(path, interval=60.0, count=10, quantity="disturbance", **keys):
    readings = Readings(source=str(path), **keys)
    return recorded_scans(readings, None, quantity, (BEGIN, interval, count))


def test_each_reading_keeps_its_time_and_none_is_made(tmp_path):
    """And depths count downwards."""
    value = np.arange(11.0)
    value[4] = np.nan
    path = write(tmp_path / "a.csv", {"time": EVERY_MINUTE, "faa": value, "depth": 100.0 + value})
    found = scans(path, column="faa")
    np.testing.assert_array_equal(found.time, 60.0 * np.arange(1, 11))
    np.testing.assert_allclose(found.value, value[1:] * MGAL)
    depths = scans(path, column="depth", quantity="height")
    np.testing.assert_allclose(depths.value, -100.0 - value[1:])


@pytest.mark.parametrize("phase", [1.0, 59.0])
def test_a_reading_between_the_scans_comes_with_the_next(tmp_path, phase):
    jitter = np.random.default_rng(1).uniform(-0.5, 0.5, 12)
    time = BEGIN + phase + 60.0 * np.arange(-1.0, 11.0) + jitter
    lost = (np.arange(12) == 5) | (np.arange(12) == 6)
    path = write(tmp_path / "a.csv", {"time": time[~lost], "faa": np.arange(12.0)[~lost]})
    found = scans(path)
    ends = 60.0 * np.arange(1, 11)
    there = np.isfinite(found.value)
    assert there.sum() == 8
    late = ends - found.time
    assert (late >= 0.0).all()
    assert (late < 60.0).all()
    assert np.ptp(late) <= 1.0  # those that are missing would have come between
    number = np.rint(found.value[there] / MGAL).astype(int)
    np.testing.assert_allclose(found.time[there], time[number] - BEGIN, atol=1e-6)


def test_of_a_faster_instrument_each_scan_has_the_newest_reading(tmp_path):
    time = BEGIN + 10.0 * np.arange(61.0)
    found = scans(write(tmp_path / "a.csv", {"time": time, "faa": np.arange(61.0)}))
    np.testing.assert_allclose(found.value, 6.0 * np.arange(1, 11) * MGAL)


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"column": "grav"}, r"readings\.column: \S+ has no column grav; it has time, faa, none"),
        ({"unit": "nT"}, r"column faa: unfitting unit 'nT'; must be one of m/s², mGal"),
        ({"unit": "m/s²"}, r"csv:faa: values 0 to 10 m/s² cannot be a dist.* give unit=mGal"),
        ({"source": "none.csv"}, r"none\.csv"),
        ({"begin": 0.0}, "no reading is within the track's time"),
        ({"column": "none"}, r"readings\.source: .*column none has no value at all"),
    ],
)
def test_a_bad_file_is_refused_by_column(tmp_path, keys, says):
    keys = {"column": "faa"} | keys
    time = keys.pop("begin", BEGIN) + EVERY_MINUTE - BEGIN
    columns = {"time": time, "faa": np.arange(11.0), "none": np.full(11, np.nan)}
    path = write(tmp_path / "a.csv", columns)
    with pytest.raises(InputError, match=says):
        scans(keys.pop("source", path), **keys)


@pytest.fixture
def scenario(tmp_path):
    map_file = tmp_path / "map.nc"
    write_netcdf(field_map_of(wavy), map_file)
    time = np.arange(0.0, 601.0, 10.0)
    path = write(
        tmp_path / "a.csv",
        {
            "time": BEGIN + time,
            "latitude": -36.6 + 1.4e-4 * time,
            "longitude": 146.9 + 1.6e-4 * time,
            "faa": np.arange(61.0),
            "raw": 980000.0 + np.arange(61.0),
        },
    )
    return validate_scenario(
        {
            "route": {"track": str(path)},
            "readings": {"source": str(path), "column": "faa"},
            "field": "disturbance",
            "map": {"source": str(map_file), "continuation": "none"},
            "map_error": {"sigma": 5e-5},
            "gravity": {"field": "normal"},
        }
    )


def test_what_is_reduced_is_not_reduced_again(scenario):
    reduction = measured_field(scenario).reduction(scenario)
    at = State(np.radians(-36.6), np.radians(146.9), 0.0, 3.0, 20.0)
    assert reduction.reduce(2e-5, at) == 2e-5
    assert not reduction.jacobian(at).any()
    assert reduction.height_slope(at) == 0.0
    raw = scenario.model_copy(update={"readings": Readings(source="a.csv", column="raw")})
    assert measured_field(raw).reduction(raw).jacobian(at).any()


def test_nothing_is_drawn_of_readings_nor_of_the_maps_error(scenario):
    trajectory = build_trajectory(scenario)
    assert scenario.true.map_error.sigma == 0.0
    runs = ReadingSimulator(scenario.true, trajectory, None, [0, 1])
    np.testing.assert_allclose(runs.raw, np.tile(np.arange(1, 61) * MGAL, (2, 1)))


def test_the_bound_has_the_error_that_the_map_says_of_itself(scenario):
    trajectory = build_trajectory(scenario)
    exact = field_map_of(wavy)
    rms = [
        posterior_cramer_rao(scenario.true, trajectory, replace(exact, sigma=sigma)).rms[-1]
        for sigma in (0.0, 1e-5, 5e-5)
    ]
    assert rms[0] < 0.95 * rms[1] < 0.9 * rms[2]


def test_recorded_readings_need_a_track(scenario):
    with pytest.raises(InputError, match=r"readings.source: recorded readings need the track"):
        validate_scenario({"readings": {"source": "a.csv"}})
    with pytest.raises(InputError, match=r"readings.source: must be of one number"):
        validate_scenario(
            {"route": {"track": "a"}, "readings": {"source": "a"}, "field": "gradient"}
        )
