"""Where the navigator starts: truth plus initial errors, whose 1-sigmas the scenario gives
(docs/mathematics.md, section 3.8)."""

from collections.abc import Sequence

import numpy as np

from isogal.earth.ellipsoid import metres_per_radian
from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import from_rotation_vector, multiply
from isogal.scenario import InitialError
from isogal.seeds import generator
from isogal.sensors.trajectory import Trajectory


def draw_initial_state(
    sigma: InitialError, trajectory: Trajectory, seed: int, runs: Sequence[int]
) -> Estimate:
    """Return the navigators' first states, with errors of horizontal position and velocity (the
    height is known), tilt and heading."""
    north, east = metres_per_radian(trajectory.latitude[0], trajectory.height[0])
    count = len(runs)
    position = np.tile(trajectory.position[0], (count, 1))
    velocity = np.tile(trajectory.velocity[0], (count, 1))
    attitude = np.empty((count, 4))
    for i, run in enumerate(runs):
        draw = generator(seed, run, "initial_error").standard_normal(7)
        bearing = generator(seed, run, "hidden_position").uniform(0.0, 2.0 * np.pi)
        position[i, 0] += sigma.hidden_position * np.cos(bearing) / north
        position[i, 1] += sigma.hidden_position * np.sin(bearing) / east
        position[i, 0] += sigma.position * draw[0] / north
        position[i, 1] += sigma.position * draw[1] / east
        velocity[i, :2] += sigma.velocity * draw[2:4]
        rotation = from_rotation_vector(
            sigma.tilt * draw[4], sigma.tilt * draw[5], sigma.heading * draw[6]
        )
        attitude[i] = multiply(*rotation, *trajectory.attitude[0])
    return Estimate(position, velocity, attitude)
