"""Messages of a gradiometer, and what cannot be used."""

import math

import numpy as np
import pytest
from sensor_msgs.msg import PointField

from isogal.scenario import load_scenario
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.gradiometer import GRADIOMETER
from isogal_ros.messages.stamps import from_seconds, to_ns

VALUE = np.array([1.5e-8, math.nan, -3.2e-7])
COVARIANCE = 1e-18 * np.array([[4.0, 1.0, 0.5], [1.0, 9.0, 0.0], [0.5, 0.0, 2.0]])


def of(*names):
    """The adapter of some components."""
    return adapter_of(
        load_scenario(None, ["field=gradient", f"gradiometer.components=[{','.join(names)}]"])
    )


ADAPTER = of("nn", "ed", "dd")


def message(seconds, values, covariance):
    return ADAPTER.write_raw(from_seconds(seconds), np.asarray(values, float), covariance, None)


def test_both_ways() -> None:
    made = message(12.5, VALUE, COVARIANCE)
    value, covariance = ADAPTER.read_reduced(made)
    np.testing.assert_array_equal(value, VALUE)
    np.testing.assert_array_equal(covariance, COVARIANCE)
    assert to_ns(made.header.stamp) == from_seconds(12.5)
    assert made.header.frame_id == GRADIOMETER
    assert [field.name for field in made.fields] == ["T_nn", "T_ed", "T_dd", "covariance"]
    assert (made.width, made.height, made.is_dense) == (1, 1, False)
    assert len(made.data) == made.point_step


def test_components_go_by_their_names() -> None:
    value, covariance = of("dd", "nn").read_reduced(message(1.0, VALUE, COVARIANCE))
    np.testing.assert_array_equal(value, VALUE[[2, 0]])
    np.testing.assert_array_equal(covariance, COVARIANCE[np.ix_([2, 0], [2, 0])])


def test_the_other_byte_order() -> None:
    made = message(1.0, VALUE, COVARIANCE)
    made.data = np.frombuffer(bytes(made.data), "<f8").astype(">f8").tobytes()
    made.is_bigendian = True
    np.testing.assert_array_equal(ADAPTER.read_raw(made)[0], VALUE)


def test_a_covariance_of_zero_is_an_unknown_one() -> None:
    assert ADAPTER.read_raw(message(1.0, VALUE, np.zeros((3, 3))))[1] is None


@pytest.mark.parametrize(("change", "words"), [
    (lambda m: setattr(m.header, "frame_id", "map"), "frame_id must be 'gradiometer_link'"),
    (lambda m: m.fields.pop(0), "no field T_nn; fields are T_ed, T_dd, covariance"),
    (lambda m: m.fields.pop(), "no field covariance"),
    (lambda m: setattr(m, "fields", []), r"fields are \(none\)"),
    (lambda m: setattr(m.fields[0], "datatype", PointField.FLOAT32), "T_nn must be float64"),
    (lambda m: setattr(m.fields[3], "count", 4), "field covariance must be 9 x float64"),
    (lambda m: setattr(m, "data", bytes(m.data)[:-8]), "lies beyond the end of the data"),
    (lambda m: setattr(m.fields[1], "offset", 4_000_000_000), "field T_ed lies beyond the end"),
    (lambda m: setattr(m, "width", 2), "must hold one point, holds 2"),
])  # fmt: skip
def test_what_cannot_be_read(change, words) -> None:
    made = message(1.0, VALUE, COVARIANCE)
    change(made)
    with pytest.raises(BadMessageError, match=words):
        ADAPTER.read_raw(made)


@pytest.mark.parametrize(
    ("value", "covariance", "words"),
    [
        ([30.0, 1.0, 1.0], COVARIANCE, "the unit is 1/s²"),
        ([math.inf, 0.0, 0.0], COVARIANCE, "the unit is 1/s²"),
        (VALUE, -COVARIANCE, "negative variance"),
        (VALUE, math.nan * COVARIANCE, "covariance is not finite"),
    ],
)
def test_what_is_not_of_the_earth(value, covariance, words) -> None:
    with pytest.raises(BadMessageError, match=words):
        ADAPTER.read_reduced(message(1.0, value, covariance))
