"""Fixes as PoseWithCovarianceStamped messages of the frame ``map``, for filters such as those of
robot_localization that take poses and no positions on the Earth."""

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped

from isogal.arrays import Array
from isogal.earth.frames import LocalFrame
from isogal_ros.messages.frames import NED_ENU
from isogal_ros.messages.position import NOT_MEASURED
from isogal_ros.messages.stamps import set_stamp

HEIGHT_VARIANCE = 1e4
"""m². A fix measures no height: its height is the navigator's. Far from the origin the plane of a
fix is tilted against that of the map (by 2.7 degrees after 300 km), and a variance that means
"not at all" would spill into the plane."""


def fill_pose(
    message: PoseWithCovarianceStamped,
    ns: int,
    frame: LocalFrame,
    position: tuple[float, float, float],
    covariance: Array,
) -> None:
    """Write a fix; its orientation is not measured.

    Parameters
    ----------
    frame : LocalFrame
        The frame ``map``.
    position : (latitude rad, longitude rad, height m)
    covariance : (2, 2) array
        North, east, m².
    """
    set_stamp(message.header.stamp, ns)
    point, orientation = message.pose.pose.position, message.pose.pose.orientation
    point.x, point.y, point.z = frame.from_geodetic(*position).tolist()
    orientation.w = 1.0
    local = np.diag([0.0, 0.0, HEIGHT_VARIANCE])
    local[:2, :2] = covariance
    axes = frame.rotation_from(position[0], position[1]) @ NED_ENU
    whole = np.diag([0.0, 0.0, 0.0, NOT_MEASURED, NOT_MEASURED, NOT_MEASURED])
    whole[:3, :3] = axes @ local @ axes.T
    message.pose.covariance = whole.ravel()
