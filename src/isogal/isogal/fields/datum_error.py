"""How a map's datum may be wrong: an offset, and a tilt of the whole map."""

from collections.abc import Sequence

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.scenario import Truth
from isogal.seeds import generator
from isogal.sensors.trajectory import Trajectory


def draw_datum_error(
    scenario: Truth,
    trajectory: Trajectory,
    index: Integers,
    runs: Sequence[int],
    channels: tuple[int, ...] = (),
) -> Array:
    """Return (R, scans, *channels) how far the true field is above the map by `map_error.offset`
    and `map_error.tilt`, in its unit.

    A plane a + b x + c y, north x and east y from the route's start; a, b and c are drawn once per
    run and channel.

    Parameters
    ----------
    scenario : Truth
    trajectory : Trajectory
    index : (scans,) array
        Of the scans in the trajectory.
    runs : sequence of int
        They seed the random streams.
    channels : tuple of int
        Shape of a reading.
    """
    settings = scenario.map_error
    if settings.offset == 0.0 and settings.tilt == 0.0:
        return np.zeros((len(runs), len(index), *channels))
    latitude, longitude = trajectory.latitude, trajectory.longitude
    north, east = metres_per_radian(float(latitude[index].mean()))
    plane = np.stack(
        [
            np.full(len(index), settings.offset),
            settings.tilt * north * (latitude[index] - latitude[0]),
            settings.tilt * east * (longitude[index] - longitude[0]),
        ]
    )
    # summed for each run by itself: its numbers must not depend on how many runs are computed
    return np.stack(
        [
            np.einsum(
                "ks,k...->s...",
                plane,
                generator(scenario.seed, run, "map_datum").standard_normal((3, *channels)),
            )
            for run in runs
        ]
    )
