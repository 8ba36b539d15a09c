"""Compensation of readings as they come, against that of a whole flight."""

import math

import numpy as np
import pytest

from helpers.magnetics import Circumstances, aircraft, fly
from isogal.magnetics.compensation import Compensation
from isogal.magnetics.manoeuvres import ordinary_flight
from isogal.magnetics.stream import MOST_WAITING, CompensatedStream


@pytest.mark.parametrize(("lag", "behind"), [(0.0, 0), (0.0, 3), (0.2, 0)])
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
