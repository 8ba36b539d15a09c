"""A matcher's candidates as messages."""

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2

from isogal.matching.interfaces import Candidates
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.point import candidates_cloud, read_candidates


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
