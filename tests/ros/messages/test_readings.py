"""Messages of magnetometer and clearance meter: both ways, and what cannot be used."""

import math

import numpy as np
import pytest
from sensor_msgs.msg import MagneticField, NavSatStatus, Range

from isogal.fields.measured import FIELDS
from isogal.scenario import load_scenario
from isogal_ros.messages.readings import ADAPTERS
from isogal_ros.messages.stamps import from_seconds, to_ns
from isogal_ros.nodes.health import BadMessageError

pytestmark = pytest.mark.ros
# vectors: test_gradiometer.py
VALUE = {"gravity": 9.8, "disturbance": 3e-4, "magnetic": -123.4, "terrain": 456.7}
RAW = {"gravity": 9.797, "disturbance": 9.797, "magnetic": 50123.4, "terrain": 543.25}


def magnetic(*vector, covariance=(0.0,) * 9, frame="anything"):
    message = MagneticField(magnetic_field_covariance=np.array(covariance, dtype=float))
    message.header.frame_id = frame
    message.magnetic_field.x, message.magnetic_field.y, message.magnetic_field.z = map(
        float, vector
    )
    return message


def distance(value, low=0.0, high=1000.0, variance=0.0):
    return Range(
        range=float(value), min_range=float(low), max_range=float(high), variance=float(variance)
    )


def test_every_field_has_its_messages() -> None:
    assert set(ADAPTERS) == set(FIELDS)
    for name, field in FIELDS.items():
        assert (ADAPTERS[name].raw is ADAPTERS["gravity"].raw) == (
            field.instrument == "gravimeter"
        )


@pytest.mark.parametrize("name", VALUE)
def test_both_ways(name) -> None:
    adapter = ADAPTERS[name]
    ns = from_seconds(12.5)
    raw, reduced = adapter.new_raw(load_scenario()), adapter.new_reduced()
    assert isinstance(raw, adapter.raw.type)
    assert isinstance(reduced, adapter.reduced.type)
    adapter.fill_raw(raw, ns, RAW[name], 0.25)
    value, variance = adapter.read_raw(raw)
    assert (value, variance) == (
        pytest.approx(RAW[name], rel=1e-14),
        pytest.approx(0.25, rel=1e-14),
    )
    adapter.fill_reduced(reduced, ns, VALUE[name], 0.5, (-0.6, 2.5))
    assert adapter.read_reduced(reduced) == pytest.approx((VALUE[name], 0.5), rel=1e-14)
    assert to_ns(raw.header.stamp) == to_ns(reduced.header.stamp) == ns


def test_only_the_length_of_the_magnetic_vector_counts() -> None:
    read = ADAPTERS["magnetic"].read_raw
    for vector in ((5e-5, 0.0, 0.0), (0.0, -3e-5, 4e-5), (3e-5, 4e-5, 0.0)):
        assert read(magnetic(*vector))[0] == pytest.approx(5e4, rel=1e-14)
    # the variance of the length is that of the component along the vector
    covariance = np.diag([1e-18, 4e-18, 9e-18])
    assert read(magnetic(3e-5, 0.0, 4e-5, covariance=covariance.ravel()))[1] == pytest.approx(
        0.36 * 1.0 + 0.64 * 9.0
    )


def test_zero_variance_is_an_unknown_one() -> None:
    assert ADAPTERS["magnetic"].read_raw(magnetic(0.0, 0.0, 5e-5))[1] is None
    assert ADAPTERS["terrain"].read_raw(distance(100.0))[1] is None


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (magnetic(math.nan, 0.0, 5e-5), "not finite"),
        (magnetic(math.nan, math.nan, 5e-5), "needs all three"),
        (magnetic(math.inf, 0.0, 5e-5), "not finite"),
        (magnetic(0.0, 0.0, 0.0), "a total field of 0 T is not the Earth's"),
        (magnetic(0.0, 30.0, 40.0), "a total field of 50 T is not the Earth's; the unit is tesla"),
        (magnetic(0.0, 0.3, 0.4), "the unit is tesla"),
        (magnetic(0.0, 0.0, 5e-5, covariance=[-1e-18] + [0.0] * 8), "negative variance"),
        (magnetic(0.0, 0.0, 5e-5, covariance=[math.nan] + [0.0] * 8), "covariance is not finite"),
    ],
)  # fmt: skip
def test_magnetic_fields_that_cannot_be_used(message, words) -> None:
    with pytest.raises(BadMessageError, match=words):
        ADAPTERS["magnetic"].read_raw(message)


@pytest.mark.parametrize("message", [
    distance(math.inf), distance(-math.inf), distance(1000.5), distance(4.9, low=5.0), distance(-1.0),
])  # fmt: skip
def test_out_of_range_is_no_reading_and_no_fault(message) -> None:
    value, _ = ADAPTERS["terrain"].read_raw(message)
    assert math.isnan(value)


def test_the_ends_of_the_range_are_in_it() -> None:
    read = ADAPTERS["terrain"].read_raw
    assert [read(distance(x, 5.0, 1000.0))[0] for x in (5.0, 1000.0)] == [5.0, 1000.0]


@pytest.mark.parametrize(("message", "words"), [
    (distance(math.nan), "not a number"),
    (distance(10.0, 10.0, 10.0), "fixed distance"),
    (distance(10.0, 20.0, 5.0), "min_range 20 m is not below max_range 5 m"),
    (distance(10.0, math.nan, 5.0), "is not below"),
    (distance(10.0, variance=-1.0), "negative variance"),
    (distance(10.0, variance=math.nan), "variance is not finite"),
])  # fmt: skip
def test_ranges_that_cannot_be_used(message, words) -> None:
    with pytest.raises(BadMessageError, match=words):
        ADAPTERS["terrain"].read_raw(message)


def test_nothing_in_range_is_infinity_then_no_altitude() -> None:
    adapter = ADAPTERS["terrain"]
    raw, reduced = (
        adapter.new_raw(load_scenario(None, ["altimeter.max_range=700"])),
        adapter.new_reduced(),
    )
    adapter.fill_raw(raw, 0, math.nan, 1.0)
    assert (raw.range, raw.max_range) == (math.inf, 700.0)
    adapter.fill_reduced(reduced, 0, math.nan, 1.0, None)
    assert reduced.status.status == NavSatStatus.STATUS_NO_FIX
    assert math.isnan(adapter.read_reduced(reduced)[0])
    reduced.status.status = NavSatStatus.STATUS_FIX  # says it has one
    with pytest.raises(BadMessageError, match="not finite"):
        adapter.read_reduced(reduced)


@pytest.mark.parametrize("name", ["magnetic", "terrain"])
def test_reduced_readings_that_cannot_be_used(name) -> None:
    adapter = ADAPTERS[name]
    for value, variance, words in (
        (math.inf, 1.0, "not finite"),
        (1.0, math.nan, "not finite"),
        (1.0, -1.0, "negative"),
    ):
        message = adapter.new_reduced()
        adapter.fill_reduced(message, 0, value, variance, (0.0, 0.0))
        with pytest.raises(BadMessageError, match=words):
            adapter.read_reduced(message)


def test_an_anomaly_is_reported_along_the_main_field_only() -> None:
    message = ADAPTERS["magnetic"].new_reduced()
    ADAPTERS["magnetic"].fill_reduced(message, 0, 100.0, 4.0, None)
    assert math.isnan(message.magnetic_field.x) and math.isnan(message.magnetic_field.y)
    assert message.magnetic_field.z == pytest.approx(1e-7)
    assert message.magnetic_field_covariance[8] == pytest.approx(4e-18)
