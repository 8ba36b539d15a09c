"""All that a fix says, there and back, and what cannot be used."""

import numpy as np
import pytest
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
NOTHING = np.full((2, 2), np.nan)
ESTIMATE = Estimate(
    np.array([-0.6, 2.5, 90.0]), np.array([10.0, -3.0, 0.1]), np.array(from_heading(0.7))
)


def information(size: int) -> Information:
    return Information(np.arange(float(size)), random_covariance(np.ones(size), size))


def sent(whole: FixMessage) -> PointCloud2:
    """Its message, as it comes."""
    message = PointCloud2()
    fill_fix_information(message, 12_500_000_000, whole)
    return deserialize_message(serialize_message(message), PointCloud2)


WIDE = random_covariance(np.array([50.0, 50.0, 0.1, 0.1, 1e-5, 1e-5, 1e-4]), 3)


@pytest.mark.parametrize(
    ("covariance", "estimate", "keys"),
    [
        (COVARIANCE, None, {}),
        (COVARIANCE, ESTIMATE, {"widened": WIDE}),
        (COVARIANCE, ESTIMATE, {"information": information(7), "map_error": (8e-5, 3000.0)}),
        (NOTHING, ESTIMATE, {"reason": "none", "reset": True, "map_error": (8e-5, 3000.0)}),
    ],
    ids=["position", "widened", "7 states", "no fix"],
)
def test_there_and_back(covariance, estimate, keys) -> None:
    one = Fix(12.5, -0.6, 2.5, covariance, **keys)
    whole = read_fix_information(sent(FixMessage(one, estimate)))
    got = whole.fix
    assert (got.time, got.published, got.reset) == (12.5, one.published, one.reset)
    assert got.map_error == one.map_error
    if one.published:
        assert (got.latitude, got.longitude) == pytest.approx((-0.6, 2.5), abs=1e-15)
    if one.widened is not None:
        np.testing.assert_allclose(got.widening, WIDE, rtol=1e-12)
    if one.information is None:
        np.testing.assert_array_equal(got.covariance, covariance)
    else:
        np.testing.assert_array_equal(got.information.vector, one.information.vector)
        np.testing.assert_array_equal(got.information.matrix, one.information.matrix)
    assert (whole.relative_to is None) == (estimate is None)
    for there, back in zip(estimate or (), whole.relative_to or (), strict=True):
        np.testing.assert_allclose(back, there, rtol=0, atol=1e-15)


def broken(**changes) -> PointCloud2:
    """A message with some numbers replaced, or fields left out (None)."""
    message = sent(FixMessage(Fix(1.0, -0.6, 2.5, COVARIANCE, information=information(7))))
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
    """What may be wrong with the layout, tests of the instruments' messages say."""
    with pytest.raises(BadMessageError, match=words):
        read_fix_information(broken(**changes))


def test_candidates_there_and_back() -> None:
    random = np.random.default_rng(0)
    latitude, longitude = random.uniform(-1, 1, 9), random.uniform(-3, 3, 9)
    candidates = Candidates(latitude, longitude, random.uniform(0, 1, 9), np.arange(9) % 4)
    cloud = candidates_cloud(8, candidates)
    assert cloud.width * cloud.point_step == cloud.row_step == len(cloud.data)
    back = read_candidates(cloud)
    np.testing.assert_allclose(back.latitude, latitude, atol=1e-15)
    np.testing.assert_allclose(back.longitude, longitude, atol=1e-15)
    np.testing.assert_array_equal(back.weight, candidates.weight)
    np.testing.assert_array_equal(back.scan, candidates.scan)
    assert candidates_cloud(8, None).width == 0
    with pytest.raises(BadMessageError, match="fields must be"):
        read_candidates(PointCloud2())
