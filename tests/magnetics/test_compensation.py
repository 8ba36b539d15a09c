"""Compensation: its terms, its file, readings as they come, and what is learnt while flying."""

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml

from helpers.magnetics import BAD_SENSOR, INTENSITY, STROBE, Circumstances, aircraft, fly, spread
from isogal.errors import InputError
from isogal.magnetics.compensation import Compensation, read_compensation
from isogal.magnetics.manoeuvres import ordinary_flight
from isogal.magnetics.online import learn_along
from isogal.magnetics.stream import MOST_WAITING, CompensatedStream
from isogal.magnetics.terms import COUNT, SCALE, names, terms


def test_columns_in_the_order_and_scale_of_the_literature():
    # Gnadt et al. 2022, by hand for one reading
    vector, rate, total = np.array([3.0e4, 0.0, 4.0e4]), np.array([10.0, 20.0, 30.0]), 5.0e4
    row = terms(vector[None], rate[None], np.array([total]), np.array([[2.0]]))[0]
    u = np.array([0.6, 0.0, 0.8])
    np.testing.assert_allclose(row[:3], u)
    np.testing.assert_allclose(row[3:9], np.array([0.36, 0.0, 0.48, 0.0, 0.0, 0.64]) * 1.0)
    np.testing.assert_allclose(row[9:18], np.outer(u, rate).ravel() / SCALE)
    np.testing.assert_allclose(row[18:], 2.0 * u)
    assert len(names(("strobe",))) == len(row) == COUNT + 3


def compensation():
    coefficients = np.concatenate([aircraft().coefficients(), STROBE])
    return Compensation(coefficients, ("strobe",), 3.5, 0.1, 0.01 * np.abs(coefficients))


def test_there_and_back(tmp_path):
    compensation().write(tmp_path / "a.yaml")
    found = read_compensation(tmp_path / "a.yaml")
    for name in ("coefficients", "currents", "offset", "lag", "sigma"):
        np.testing.assert_array_equal(getattr(found, name), getattr(compensation(), name))


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("isogal_magnetic_compensation", 2, "version 2"),
        ("scale_nt", 1.0, "scale_nt"),
        ("permanent", {"x": 1.0, "y": 2.0}, "permanent"),
        ("induced", "much", "induced"),
        ("offset", float("nan"), "offset"),
        ("lag", True, "lag"),
        ("currents", {"strobe": [1.0]}, "currents.strobe"),
        ("sigma", [1.0], "sigma"),
        ("color", 1, "unknown key 'color'"),
    ],
)
def test_files_that_are_refused(tmp_path, key, value, said):
    document = compensation().document() | {key: value}
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
    with pytest.raises(InputError, match=said):
        read_compensation(tmp_path / "a.yaml")


@pytest.mark.parametrize("text", ["", "- 1", "a: [", "!!python/object:os.system x", "a: 1"])
def test_files_of_another_kind(tmp_path, text):
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(InputError, match=r"a\.yaml"):
        read_compensation(tmp_path / "a.yaml")
    with pytest.raises(InputError, match="cannot be read"):
        read_compensation(tmp_path / "none.yaml")


def test_a_current_that_was_not_recorded_is_named():
    readings, _ = fly(ordinary_flight(1, minutes=1.0), aircraft())
    with pytest.raises(InputError, match="current_strobe"):
        compensation().clean(readings)


@pytest.mark.parametrize(("lag", "behind"), [(0.0, 3), (0.2, 0)])
def test_a_stream_gives_what_the_whole_flight_gives(lag, behind):
    around = Circumstances(noise=0.0, lag=lag)
    readings, total = fly(ordinary_flight(2, minutes=2.0), aircraft(), around)
    compensation = Compensation(aircraft().coefficients(), lag=lag)
    stream, found = CompensatedStream(compensation), {}
    for i in range(len(readings) + behind):
        if i < len(readings):
            stream.scalar(readings.time[i], readings.total[i], i)
        if i >= behind:
            stream.vector(readings.time[i - behind], readings.vector[i - behind])
        found |= {item: value for value, item in stream.ready()}
    assert list(found) == list(range(len(found)))
    assert len(found) >= len(readings) - 4
    clean = np.array(list(found.values()))
    whole = compensation.clean(readings)[: len(clean)]
    inside = slice(5, len(clean) - 5)
    np.testing.assert_allclose(clean[inside], whole[inside], atol=0.5)
    assert np.abs(clean[inside] - total[: len(clean)][inside]).max() < 1.5
    assert np.ptp(readings.total - total) > 60.0


def stream_of(*vectors):
    stream = CompensatedStream(Compensation(aircraft().coefficients()))
    for time, vector in vectors:
        stream.vector(time, np.array(vector))
    return stream


def test_without_a_vector_there_is_no_reading():
    stream = stream_of((0.0, (0.0, 3e4, 4e4)), (5.0, (0.0, 3e4, 4e4)), (5.5, (0.0, 3e4, 4e4)))
    for time in (0.0, 2.0, 5.2):
        stream.scalar(time, 5e4, time)
    found = {item: value for value, item in stream.ready()}
    assert [math.isnan(value) for value in found.values()] == [True, True, False]


def test_a_silent_vector_magnetometer_holds_nothing_up():
    stream = stream_of()
    for k in range(MOST_WAITING):
        stream.scalar(10.0 * k, 5e4, k)
    assert list(stream.ready()) == []
    stream.scalar(100.0, 5e4, "last")
    (value, item), *others = stream.ready()
    assert (item, others) == (0, [])
    assert math.isnan(value)
    stream.vector(1.0, np.zeros(3))
    stream.vector(0.5, np.ones(3))  # late: left out
    assert len(stream._vectors) == 1


def learnt(readings, start=None, **keys):
    return learn_along(readings, np.full(len(readings), INTENSITY), start, **keys)


def test_cold_start():
    around = Circumstances(errors=BAD_SENSOR)
    readings, total = fly(ordinary_flight(3, minutes=14.0, rate=5.0), aircraft(), around)
    found = learnt(readings)
    error = readings.total - found.own - total
    late = readings.time > 600.0
    assert np.ptp(readings.total[late] - total[late]) > 150.0
    assert spread(error[late]) < 10.0
    assert np.sqrt(np.nanmean(error[late] ** 2)) < 10.0
    # it knows how little it knows
    assert np.nanmean((error[late] / found.sigma[late]) ** 2) < 1.0


def test_a_calibrated_start_is_good_at_once():
    craft = aircraft()
    readings, total = fly(ordinary_flight(4, minutes=3.0, rate=5.0), craft)
    known = craft.coefficients()
    start = Compensation(known, sigma=np.full(known.size, 2.0))
    for found, least, most in (
        (learnt(readings, start, offset_sigma=2.0), 0.0, 8.0),
        (learnt(readings), 12.0, np.inf),
    ):
        assert least < spread((readings.total - found.own - total)[100:]) < most


def test_missing_readings_change_nothing():
    readings, _ = fly(ordinary_flight(4, minutes=0.5, rate=5.0), aircraft())
    rows = slice(0, 100)
    parts = {name: getattr(readings, name)[rows] for name in ("time", "total", "vector")}
    first = replace(readings, **parts)
    total = readings.total.copy()
    total[100:] = np.nan
    alone, gone = learnt(first), learnt(replace(readings, total=total))
    np.testing.assert_array_equal(gone.own[rows], alone.own)
    assert np.isnan(gone.own[100:]).all()
    assert np.isnan(gone.sigma[100:]).all()
    np.testing.assert_array_equal(gone.compensation.coefficients, alone.compensation.coefficients)
    unknown = np.where(np.arange(len(readings)) < 100, INTENSITY, np.nan)
    of_map = learn_along(readings, unknown)
    np.testing.assert_allclose(
        of_map.compensation.coefficients, alone.compensation.coefficients, rtol=1e-9
    )
