"""What a navigator leaves of horizontal gravity that takes it off at the wrong place."""

import numpy as np
import pytest

from helpers.batches import field_map_of
from isogal.inertial.gravity import compensation_by, misplaced, no_compensation
from isogal.maps.channels import ChannelMap

SIGMA, LENGTH = 2e-4, 3000.0


def drawn(seed: int):
    """A map of the covariance SIGMA² exp(-d² / 2 LENGTH²): many waves."""
    random = np.random.default_rng(seed)
    waves, phase = random.standard_normal((2, 200)) / LENGTH, random.uniform(0.0, 2.0 * np.pi, 200)

    def value(north, east):
        angle = np.multiply.outer(north, waves[0]) + np.multiply.outer(east, waves[1]) + phase
        return SIGMA * np.sqrt(2.0 / 200) * np.cos(angle).sum(axis=-1)

    return field_map_of(value, half=60e3, step=600.0)


@pytest.mark.parametrize("spread", [500.0, 3000.0, 8e3])
def test_what_is_taken_off_elsewhere_is_left(spread):
    """Within a quarter: one map is one draw."""
    maps = ChannelMap((drawn(1), drawn(2)))
    compensation = compensation_by(maps, 1.0)
    assert compensation.feature == pytest.approx(LENGTH, rel=0.1)
    random = np.random.default_rng(3)
    here = random.uniform(-45e3, 45e3, (20000, 2))
    there = here + spread * random.standard_normal(here.shape)
    there = there[inside := (np.abs(there) < 55e3).all(axis=1)]
    one = maps.channels[0]
    middle = one.latitude.mean(), one.longitude.mean()
    metres = np.ptp(one.latitude) / 120e3, np.ptp(one.longitude) / 120e3
    values = [
        one.value(middle[0] + at[:, 0] * metres[0], middle[1] + at[:, 1] * metres[1])
        for at in (here[inside], there)
    ]
    left = np.square(values[1] - values[0]).mean()
    assert misplaced(compensation, spread**2) == pytest.approx(left, rel=0.25)
    half = compensation_by(maps, 0.5)
    assert misplaced(half, spread**2) == pytest.approx(
        0.25 * misplaced(compensation, spread**2), rel=1e-9
    )
    assert misplaced(no_compensation(), spread**2) == 0.0
