"""Dead reckoning against differences of positions."""

import numpy as np
import pytest

from isogal.earth.frames import horizontal_difference
from isogal.inertial.dead_reckoning import dead_reckoned


@pytest.mark.parametrize("seconds", [0.0, 0.4, -0.5])
def test_it_moves_with_the_velocity(seconds):
    before, velocity = np.array([-0.6, 2.5, 100.0]), np.array([12.0, -20.0, 3.0])
    after = dead_reckoned(before, velocity, seconds)
    shift = horizontal_difference(*after[:2], *before[:2])
    assert shift == pytest.approx([12.0 * seconds, -20.0 * seconds], rel=1e-4)
    assert after[2] == before[2]
