"""The node with the scenario key fusion.filter."""

import numpy as np
import pytest

from helpers.node_bench import bench
from isogal.earth.ellipsoid import metres_per_radian
from isogal_ros import topics

pytestmark = pytest.mark.ros


def places(scenario) -> np.ndarray:
    """What the node says after each of twenty samples and a fix that comes late; rad."""
    with bench(topics.UKF_FUSION, scenario) as made:
        for k in range(1, 21):
            made.imu(k, (0.1, 0.02 * k, -9.8))
        said = made.heard[topics.NAV_FIX.name]
        made.wait(lambda: len(said) == 21)
        start = said[0]
        made.fix(8, *np.radians([start.latitude + 5e-4, start.longitude - 5e-4]))
        made.wait(lambda: len(said) == 22)
        return np.radians([(message.latitude, message.longitude) for message in said])


def test_the_reference_filter_says_the_same(scenario) -> None:
    compiled, reference = (
        places(scenario(f"fusion.filter={name}")) for name in ("compiled", "reference")
    )
    metres = metres_per_radian(compiled[0, 0])
    assert np.abs((compiled[-1] - compiled[-2]) * metres).max() > 10.0  # the fix
    assert np.abs((reference - compiled) * metres).max() < 1e-6
    assert (reference != compiled).any()
