"""Names of frames, and the axes of messages and library.

The library has body axes forward, right, down (FRD), local axes north, east, down (NED), and
radians; messages have forward, left, up (FLU), east, north, up (ENU), and degrees (REP-103). The
frame ``map`` is ENU at the first route point, exact through ECEF
(`isogal.earth.frames.LocalFrame`)."""

import numpy as np

from isogal.earth.frames import LocalFrame
from isogal.scenario import Scenario
from isogal.sensors.trajectory import first_place
from isogal_ros.messages.stamps import set_stamp
from isogal_ros.topics import Message, Topic

MAP, ODOM, BASE, GEODETIC = "map", "odom", "base_link", "wgs84"
"""Frames of the navigation, of dead reckoning, of the vehicle, and of geodetic coordinates. Those
of the instruments are in their adapters' modules."""
ANTENNA = "gnss_link"
"""Of the simulated satellite antenna; the filter takes any."""

FRD_FLU = np.array([1.0, -1.0, -1.0])
"""Factors of the components of a vector FRD that give it FLU, and the reverse."""
NED_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Rotation NED to ENU, and the reverse."""


def map_frame(scenario: Scenario) -> LocalFrame:
    """Return the frame ``map`` of a scenario: ENU at the first route point, at the vehicle's
    height."""
    return LocalFrame(*first_place(scenario.route), scenario.route.height)


def framed(topic: Topic, frame: str, ns: int = 0) -> Message:
    """Return an empty message of a topic, in a frame and of a stamp."""
    message = topic.type()
    message.header.frame_id = frame
    set_stamp(message.header.stamp, ns)
    return message
