"""All that a fix says, there and back, and what cannot be used."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2

from helpers.navigators import random_covariance
from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import from_heading
from isogal.matching.interfaces import Candidates, Fix, Information
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.fix_information import (
    FixMessage,
    fill_fix_information,
    read_fix_information,
)
from isogal_ros.messages.point import candidates_cloud, fill_point, read_candidates, read_point

COVARIANCE = np.array([[400.0, 30.0], [30.0, 900.0]])
ESTIMATE = Estimate(
    np.array([-0.6, 2.5, 90.0]), np.array([10.0, -3.0, 0.1]), np.array(from_heading(0.7))
)


def information(size: int) -> Information:
    return Information(np.arange(float(size)), random_covariance(np.ones(size), size))


def message_of(whole: FixMessage) -> PointCloud2:
    message = PointCloud2()
    fill_fix_information(message, 12_500_000_000, whole)
    return deserialize_message(serialize_message(message), PointCloud2)


@pytest.mark.parametrize("size", [None, 4, 7])
@pytest.mark.parametrize("lost", [False, True])
@pytest.mark.parametrize("estimate", [None, ESTIMATE])
def test_there_and_back(size, lost, estimate) -> None:
    what = None if size is None else information(size)
    sent = Fix(12.5, -0.6, 2.5, COVARIANCE, information=what, reset=lost)
    got = read_fix_information(message_of(FixMessage(sent, estimate)))
    assert (got.fix.time, got.fix.published, got.fix.reset) == (12.5, True, lost)
    assert (got.fix.latitude, got.fix.longitude) == pytest.approx((-0.6, 2.5), abs=1e-15)
    if what is None:
        np.testing.assert_array_equal(got.fix.covariance, COVARIANCE)
    else:
        np.testing.assert_array_equal(got.fix.information.vector, what.vector)
        np.testing.assert_array_equal(got.fix.information.matrix, what.matrix)
    assert (got.relative_to is None) == (estimate is None)
    if estimate is not None:
        for one, other in zip(got.relative_to, estimate, strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-15)


def test_a_navigator_that_is_to_become_less_certain() -> None:
    wide = random_covariance(np.array([50.0, 50.0, 0.1, 0.1, 1e-5, 1e-5, 1e-4]), 3)
    sent = Fix(12.5, -0.6, 2.5, COVARIANCE, widened=wide)
    got = read_fix_information(message_of(FixMessage(sent, ESTIMATE)))
    np.testing.assert_allclose(got.fix.widening, wide, rtol=1e-12)


@pytest.mark.parametrize("reason", [None, "nothing"])
def test_how_wrong_the_map_is(reason) -> None:
    sent = Fix(12.5, -0.6, 2.5, COVARIANCE, reason, map_error=(8e-5, 3000.0))
    got = read_fix_information(message_of(FixMessage(sent, ESTIMATE)))
    assert got.fix.map_error == (8e-5, 3000.0)


def test_no_fix() -> None:
    none = Fix(12.5, -0.6, 2.5, np.full((2, 2), np.nan), "nothing", reset=True)
    got = read_fix_information(message_of(FixMessage(none, ESTIMATE))).fix
    assert (got.published, got.reset) == (False, True)


@given(
    st.integers(0, 2**31 * 10**9 - 1),
    st.dictionaries(st.text("abc_", min_size=1), st.lists(st.floats(), min_size=1, max_size=9)),
)
def test_named_numbers(ns, values) -> None:
    message = PointCloud2()
    fill_point(message, ns, {name: np.array(numbers) for name, numbers in values.items()})
    got = read_point(deserialize_message(serialize_message(message), PointCloud2))
    assert got.keys() == values.keys()
    for name, numbers in values.items():
        np.testing.assert_array_equal(got[name], numbers)


def broken(**changes) -> PointCloud2:
    """A message with some numbers replaced, or fields left out (None)."""
    message = message_of(FixMessage(Fix(1.0, -0.6, 2.5, COVARIANCE, information=information(7))))
    values = read_point(message) | {name: np.atleast_1d(v) for name, v in changes.items()}
    fill_point(message, 10**9, {k: v for k, v in values.items() if v[0] is not None})
    return message


@pytest.mark.parametrize(("changes", "words"), [
    ({"published": None}, "no field published; fields are lost,"),
    ({"lost": 0.5}, "field lost must be 0 or 1"),
    ({"latitude": np.nan}, "field latitude is not finite"),
    ({"latitude": 91.0}, "of no place"),
    ({"vector": np.ones(5)}, "field vector must have 4 or 7"),
    ({"vector": None}, "field vector must have 4 or 7"),
    ({"vector": np.ones(4)}, "field matrix must be 16 x float64, has 49"),
    ({"matrix": np.full(49, np.inf)}, "field matrix is not finite"),
    ({"from_position": np.zeros(3)}, "no field from_attitude"),
    ({"widening": -np.eye(7).ravel()}, "widening is not a covariance"),
    ({"map_error": np.array([8e-5, 0.0])}, "map_error must be positive"),
])  # fmt: skip
def test_what_cannot_be_used(changes, words) -> None:
    with pytest.raises(BadMessageError, match=words):
        read_fix_information(broken(**changes))


def test_another_frame() -> None:
    """What else may be wrong with the layout, tests of the gradiometer's messages say."""
    good = broken()
    good.header.frame_id = "map"
    with pytest.raises(BadMessageError, match="frame_id"):
        read_fix_information(good)


def test_both_ways() -> None:
    random = np.random.default_rng(0)
    candidates = Candidates(
        random.uniform(-1, 1, 9),
        random.uniform(-3, 3, 9),
        random.uniform(0, 1, 9),
        np.arange(9) % 4,
    )
    cloud = candidates_cloud(8, candidates)
    assert [field.name for field in cloud.fields] == ["latitude", "longitude", "weight", "scan"]
    assert cloud.width * cloud.point_step == cloud.row_step == len(cloud.data)
    back = read_candidates(cloud)
    np.testing.assert_allclose(back.latitude, candidates.latitude, atol=1e-15)
    np.testing.assert_allclose(back.longitude, candidates.longitude, atol=1e-15)
    np.testing.assert_array_equal(back.weight, candidates.weight)
    np.testing.assert_array_equal(back.scan, candidates.scan)
    assert candidates_cloud(8, None).width == 0


def test_other_clouds_are_refused() -> None:
    with pytest.raises(BadMessageError, match="fields must be"):
        read_candidates(PointCloud2())
