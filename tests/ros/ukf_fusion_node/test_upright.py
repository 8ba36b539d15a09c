"""Gravity where the navigator has it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ukf_fusion_node.watch import LASTS, Upright

BANKED = Rotation.from_euler("ZYX", [40.0, 5.0, 60.0], degrees=True)
"""Heading, pitch and roll of a turn with twice the weight on its wings."""
LEVEL = Rotation.identity()
UP = np.array([0.0, 0.0, -9.8])


def told(force: np.ndarray, turn: Rotation = LEVEL, minutes: float = 1.0) -> str:
    """Return what is said of a minute or more of the same sample."""
    upright, said = Upright(), None
    attitude = turn.as_quat()[[3, 0, 1, 2]]
    for time in np.arange(0.0, minutes * LASTS + 0.1):
        said = upright.take(time, force, attitude)
    return said or ""


def test_a_level_and_a_banked_vehicle_are_upright() -> None:
    assert told(UP) == ""
    turning = BANKED.inv().apply([12.0, -12.0, -9.8])
    assert told(turning, BANKED) == ""
    assert np.linalg.norm(turning) > 18.0


@pytest.mark.parametrize(
    ("force", "turn"),
    [(-UP, LEVEL), (UP / 9.8, LEVEL), (UP, BANKED)],
    ids=["z down", "in g", "attitude lost"],
)
def test_what_is_not_gravity_is_said_after_a_minute(force, turn) -> None:
    assert told(force, turn, 0.9) == ""
    assert "upwards, not 9.81: axes" in told(force, turn)


def test_a_wave_is_not_a_fault() -> None:
    """Half a minute of each: what counts is the mean."""
    upright, wave = Upright(), np.array([0.0, 0.0, 5.0])
    for time in np.arange(0.0, 300.0):
        force = UP + wave * np.sin(2.0 * np.pi * time / 10.0)
        assert upright.take(time, force, np.array([1.0, 0.0, 0.0, 0.0])) is None
