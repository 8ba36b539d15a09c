"""Messages of the instruments of each field, also of fields of other packages: there and back, and
what cannot be used."""

import math

import numpy as np
import pytest
from sensor_msgs.msg import MagneticField, NavSatStatus, PointField, Range

from helpers import installed
from helpers.changed_messages import changed
from isogal import plugins
from isogal.fields.measured import fields
from isogal.scenario import Altimeter, load_scenario
from isogal.sensors.altimeter import beam_directions
from isogal_ros import topics
from isogal_ros.bags.record import Collector
from isogal_ros.messages.adapter import adapter_of, topics_in_use
from isogal_ros.messages.altimeter import read_range
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.magnetometer import read_total
from isogal_ros.messages.stamps import from_seconds, to_ns

NS = from_seconds(12.5)
VALUE = {"gravity": 9.8, "disturbance": 3e-4, "magnetic": -123.4, "terrain": 456.7}
RAW = {"gravity": 9.797, "disturbance": 9.797, "magnetic": 50123.4, "terrain": 543.25}
SOIL = """
from std_msgs.msg import Header
from isogal.fields.measured import MeasuredField
from isogal.sensors.gravimeter import GravityReduction
from isogal_ros.messages.adapter import Adapter
from isogal_ros.topics import Topic

def adapter(scenario):
    raw, reduced = Topic(f"probe/{scenario.seed}", Header), Topic("probe/moisture", Header)
    return Adapter(raw, None, None, reduced, None, None)

SOIL = MeasuredField(
    "soil", "probe", "gravity", "m/s²", 0.0, 1.0, lambda scenario: GravityReduction()
)
"""


def of(field, *keys):
    """The adapter of a field."""
    return adapter_of(load_scenario(None, [f"field={field}", *keys]))


FAN = ("altimeter.beams=5", "altimeter.opening=100", "altimeter.max_range=500")
POINTS = of("terrain", *FAN, "altimeter.message=points")
SCAN = of("terrain", *FAN, "altimeter.message=scan")
LENGTH = np.float32([100.0, 120.0, 140.0, 160.0, 180.0]).astype(float)
DIRECTIONS = beam_directions(Altimeter(beams=5, opening=100.0))
SOUNDINGS = np.float32(LENGTH[:, None] * DIRECTIONS).astype(float)
TENSOR = of("gradient", "gradiometer.components=[nn,ed,dd]")
COMPONENTS = np.array([1.5e-8, math.nan, -3.2e-7])
COVARIANCE = 1e-18 * np.array([[4.0, 1.0, 0.5], [1.0, 9.0, 0.0], [0.5, 0.0, 2.0]])


def gravity(value):
    """What a gravimeter says, m/s²."""
    return of("gravity").write_raw(1, value, 1e-10, None)


def magnetic(x, y, z, variance=0.0):
    """What a magnetometer says, T; the variance is of x."""
    message = MagneticField(magnetic_field_covariance=np.array([variance, *[0.0] * 8]))
    return changed(message, magnetic_field__x=x, magnetic_field__y=y, magnetic_field__z=z)


def distance(value, low=0.0, high=1000.0, variance=0.0):
    """What an altimeter says that looks straight down, m."""
    return Range(range=value, min_range=low, max_range=high, variance=variance)


def soundings(adapter, **values):
    """What one with several beams says."""
    return changed(adapter.write_raw(0, SOUNDINGS, 0.25, None), **values)


def tensor(value=COMPONENTS, covariance=COVARIANCE, field=None, **values):
    """What a gradiometer says, with changes of the message, or of one of its fields."""
    message = TENSOR.write_raw(NS, np.asarray(value, float), covariance, None)
    changed(message if field is None else message.fields[field], **values)
    return message


@pytest.fixture
def soil(tmp_path):
    """A scenario of a field of another package, with its messages."""
    with installed.known(tmp_path):
        of = {"fields": {"soil": "soil:SOIL"}, "message_adapters": {"soil": "soil:adapter"}}
        installed.install(tmp_path, "soil", SOIL, **of)
        yield load_scenario(None, ["seed=3", "field=soil"])


def test_every_field_has_its_messages_also_one_of_another_package(soil) -> None:
    assert set(plugins.names(plugins.MESSAGE_ADAPTERS)) == set(fields())
    adapter = adapter_of(soil)
    assert adapter.raw.name == "probe/3"
    assert {adapter.raw, adapter.reduced} <= set(topics_in_use(soil)) - {*topics.ALL}
    assert adapter.reduced in Collector(soil).topics()


def test_topics_of_sensors_that_are_not_there_are_not_in_use() -> None:
    plain = set(topics_in_use(load_scenario()))
    of_magnetic = {topics.MAGNETIC_FIELD, topics.SCALAR_FIELD, topics.ANOMALY}
    of_others = {topics.TERRAIN, topics.BAROMETER, topics.VELOCITY, topics.SMOOTHED}
    assert {topics.GRAVIMETRY, topics.GRAVITY, topics.DISTURBANCE, topics.POSE} <= plain
    assert not plain & (of_others | of_magnetic)
    keys = "height.source=barometer", "velocity.kind=log", "fusion.lag=20"
    assert of_others - {topics.TERRAIN} <= set(topics_in_use(load_scenario(None, keys)))
    found = set(topics_in_use(load_scenario(None, ["field=magnetic", "gravimeter.sigma=1"])))
    assert of_magnetic <= found and topics.GRAVITY not in found


@pytest.mark.parametrize("name", VALUE)
def test_both_ways(name) -> None:
    adapter = of(name)
    raw = adapter.write_raw(NS, RAW[name], 0.25, None)
    reduced = adapter.write_reduced(NS, VALUE[name], 0.5, (-0.6, 2.5))
    assert isinstance(raw, adapter.raw.type)
    assert isinstance(reduced, adapter.reduced.type)
    assert adapter.read_raw(raw) == pytest.approx((RAW[name], 0.25), rel=1e-14)
    assert adapter.read_reduced(reduced) == pytest.approx((VALUE[name], 0.5), rel=1e-14)
    assert to_ns(raw.header.stamp) == to_ns(reduced.header.stamp) == NS


def test_a_barometer_on_the_ground_says_a_height() -> None:
    adapter = of("ground")
    raw = adapter.write_raw(7, 123.4, 0.25, None)
    assert raw.fluid_pressure == pytest.approx(99849.0, abs=50.0)  # ISA at 123.4 m
    assert adapter.read_raw(raw) == pytest.approx((123.4, 0.25), rel=1e-6)
    nothing, variance = adapter.read_raw(adapter.write_raw(7, math.nan, 0.25, None))
    assert math.isnan(nothing) and variance is None
    reduced = adapter.write_reduced(7, 120.0, 0.5, (0.7, -1.3))
    assert adapter.read_reduced(reduced) == pytest.approx((120.0, 0.5))


def test_only_the_length_of_the_magnetic_vector_counts() -> None:
    for vector in ((0.0, -3e-5, 4e-5), (3e-5, 4e-5, 0.0)):
        assert read_total(magnetic(*vector))[0] == pytest.approx(5e4, rel=1e-14)
    # the variance of the length is that of the component along the vector
    message = magnetic(3e-5, 0.0, 4e-5)
    message.magnetic_field_covariance = np.diag([1e-18, 4e-18, 9e-18]).ravel()
    assert read_total(message)[1] == pytest.approx(0.36 * 1.0 + 0.64 * 9.0)


@pytest.mark.parametrize("read_and_message", [
    (read_range, distance(100.0)),
    (read_total, magnetic(0.0, 0.0, 5e-5)),
    (TENSOR.read_raw, tensor(covariance=np.zeros((3, 3)))),
])  # fmt: skip
def test_zero_variance_is_an_unknown_one(read_and_message) -> None:
    read, message = read_and_message
    assert read(message)[1] is None


@pytest.mark.parametrize(
    ("value", "found"), [(1000.5, math.nan), (4.9, math.nan), (5.0, 5.0), (1000.0, 1000.0)]
)
def test_out_of_range_is_no_reading_and_no_fault(value, found) -> None:
    assert read_range(distance(value, 5.0))[0] == pytest.approx(found, nan_ok=True)


def test_nothing_in_range_is_infinity_then_no_altitude() -> None:
    adapter = of("terrain", "altimeter.max_range=700")
    raw = adapter.write_raw(0, math.nan, 1.0, None)
    assert (raw.range, raw.max_range) == (math.inf, 700.0)
    reduced = adapter.write_reduced(0, math.nan, 1.0, None)
    assert reduced.status.status == NavSatStatus.STATUS_NO_FIX
    assert math.isnan(adapter.read_reduced(reduced)[0])
    reduced.status.status = NavSatStatus.STATUS_FIX  # says it has one
    with pytest.raises(BadMessageError, match="not finite"):
        adapter.read_reduced(reduced)


@pytest.mark.parametrize("adapter", [POINTS, SCAN], ids=["points", "scan"])
def test_soundings_both_ways(adapter) -> None:
    sensed = SOUNDINGS.copy()
    sensed[3] = np.nan
    message = adapter.write_raw(NS, sensed, 0.25, None)
    assert to_ns(message.header.stamp) == NS
    found, variance = adapter.read_raw(message)
    assert variance is None
    order = np.argsort(found[:, 1])  # NaN last
    np.testing.assert_allclose(found[order], sensed[np.argsort(sensed[:, 1])], atol=1e-4)


def test_axes_of_points_and_of_a_scan() -> None:
    message = soundings(POINTS)
    first = np.frombuffer(bytes(message.data), "<f4").reshape(-1, 3)[0]
    assert message.header.frame_id == "base_link"
    np.testing.assert_allclose(first, (0.0, 0.0, -100.0), atol=1e-4)  # z up
    upwards, _ = POINTS.read_raw(POINTS.write_raw(0, -SOUNDINGS, 0.25, None))
    assert np.isnan(upwards).all()
    to_port = np.where(SOUNDINGS[:, 1:2] > 0.0, np.nan, SOUNDINGS)
    message = SCAN.write_raw(0, to_port, 0.25, None)
    assert message.angle_max == pytest.approx(np.radians(50.0))
    assert np.isinf(message.ranges[:2]).all() and np.isfinite(message.ranges[2:]).all()


@pytest.mark.parametrize("name", ["gravity", "magnetic", "terrain"])
@pytest.mark.parametrize(
    ("value", "variance", "words"), [(math.inf, 1.0, "not finite"), (1.0, -1.0, "negative")]
)
def test_reduced_readings_that_cannot_be_used(name, value, variance, words) -> None:
    with pytest.raises(BadMessageError, match=words):
        of(name).read_reduced(of(name).write_reduced(0, value, variance, (0.0, 0.0)))


def refused(read, *messages):
    """Rows of a table: what reads messages, a message, and words of why it cannot be used."""
    return [(read, message, words) for message, words in messages]


@pytest.mark.parametrize(("read", "message", "words"), [
    *refused(
        of("gravity").read_raw,
        (changed(gravity(9.8), header__frame_id="base_link"), "must be 'gravimeter_link'"),
        (gravity(979_812.3), "979812 is not between 5 and 20: .*the unit is m/s²"),
        (gravity(4.9), "not between"),
    ),
    *refused(of("disturbance").read_reduced, (gravity(35.2), "not between -1 and 1")),
    *refused(of("ground").read_raw,
             (changed(of("ground").write_raw(7, 1.0, 1.0, None), fluid_pressure=-1.0), "-1 Pa")),
    *refused(
        read_total,
        (magnetic(math.nan, 0.0, 5e-5), "not finite: the field needs all three"),
        (magnetic(0.0, 0.0, 0.0), "a total field of 0 T is not the Earth's"),
        (magnetic(0.0, 30.0, 40.0), "a total field of 50 T is not the Earth's; the unit is tesla"),
        (magnetic(0.0, 0.0, 5e-5, variance=-1e-18), "negative variance"),
    ),
    *refused(
        read_range,
        (distance(math.nan), "not a number"),
        (distance(10.0, 20.0, 5.0), "min_range 20 m is not below max_range 5 m"),
        (distance(10.0, math.nan, 5.0), "is not below"),
        (distance(10.0, variance=-1.0), "negative variance"),
    ),
    *refused(
        POINTS.read_raw,
        (soundings(POINTS, fields=[]), "fields x, y and z"),
        (soundings(POINTS, data=b""), "beyond the end of the data"),
        (soundings(POINTS, point_step=8), "beyond the end of the data"),
    ),
    *refused(POINTS.read_reduced,
             (POINTS.write_reduced(0, np.full((5, 4), math.inf), 0.5, None), "not finite")),
    *refused(SCAN.read_raw, (soundings(SCAN, ranges=[math.nan] * 5), "not a number")),
    *refused(
        SCAN.read_reduced,
        (of("terrain", "altimeter.beams=4").write_reduced(0, np.zeros((4, 4)), 1.0, None),
         "20 x float64"),
    ),
    *refused(
        TENSOR.read_raw,
        (tensor(header__frame_id="map"), "frame_id must be 'gradiometer_link'"),
        (tensor(field=0, name="T_ne"), "no field T_nn; fields are T_ne, T_ed, T_dd, covariance"),
        (tensor(field=0, datatype=PointField.FLOAT32), "T_nn must be float64"),
        (tensor(field=3, count=4), "field covariance must be 9 x float64"),
        (tensor(field=1, offset=4_000_000_000), "beyond the end of the data"),
        (tensor(width=2), "must hold one point, holds 2"),
        (tensor([30.0, 1.0, 1.0]), "the unit is 1/s²"),
        (tensor([math.inf, 0.0, 0.0]), "the unit is 1/s²"),
        (tensor(covariance=-COVARIANCE), "negative variance"),
        (tensor(covariance=math.nan * COVARIANCE), "covariance is not finite"),
    ),
])  # fmt: skip
def test_what_cannot_be_used(read, message, words) -> None:
    with pytest.raises(BadMessageError, match=words):
        read(message)
