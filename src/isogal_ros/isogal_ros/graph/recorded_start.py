"""Where the recorded navigator started, as parameters of the filter of a replay."""

import math

from rclpy.serialization import deserialize_message

from isogal.inertial.rotations import to_angles
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import map_frame
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.nav_sample import moved, read_nav

Start = dict[str, list[float]]
"""Parameters of ukf_fusion_node by name."""


def recorded_start(
    scenario: Scenario, fixes: dict[int, bytes], odometry: dict[int, bytes], first: int
) -> Start | None:
    """Return the start; None where the bag does not say it.

    Parameters
    ----------
    fixes, odometry : dict
        Serialised messages on nav/fix and nav/odom by stamp (ns); of the latter the first will do.
    first : int
        Stamp (ns) of the first IMU sample, before which the filter starts by one interval.
    """
    both = sorted(ns for ns in odometry if ns in fixes)
    if not both:
        return None
    try:
        sample = read_nav(
            deserialize_message(fixes[both[0]], topics.NAV_FIX.type),
            deserialize_message(odometry[both[0]], topics.NAV_ODOM.type),
            map_frame(scenario),
        )
    except BadMessageError:
        return None
    sample = moved(sample, first - from_seconds(1.0 / scenario.imu.rate))
    latitude, longitude, height = sample.position
    return {
        "start_position": [math.degrees(latitude), math.degrees(longitude), float(height)],
        "start_velocity": [float(speed) for speed in sample.velocity],
        "start_attitude": [math.degrees(angle) for angle in to_angles(sample.attitude)],
    }
