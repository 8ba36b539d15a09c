"""Frames of the messages."""

import math

import numpy as np

from isogal.scenario import load_scenario
from isogal_ros.messages.frames import map_frame


def test_frame_map_is_at_the_first_route_point() -> None:
    straight = map_frame(load_scenario(None, ["route.height=250.0"]))
    along = map_frame(
        load_scenario(
            None, ["route.height=250.0", "route.waypoints=[[-38, 144.5, 20], [-37, 146, 20]]"]
        )
    )
    np.testing.assert_array_equal(straight.origin, along.origin)
    np.testing.assert_allclose(
        straight.from_geodetic(math.radians(-38), math.radians(144.5), 250.0), 0, atol=1e-8
    )
