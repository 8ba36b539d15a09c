"""Names of frames, and the axes of messages and library.

The library has body axes forward, right, down (FRD), local axes north, east, down (NED), and
radians; messages have forward, left, up (FLU), east, north, up (ENU), and degrees (REP-103). The
frame ``map`` is ENU at the first route point, exact through ECEF
(`isogal.earth.frames.LocalFrame`)."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from isogal.earth.frames import LocalFrame
from isogal.scenario import Settings
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


@dataclass(frozen=True)
class FrameNames:
    """What the graph's frames are called outside of its nodes."""

    map: str = MAP
    odom: str = ODOM
    base: str = BASE
    prefix: str = ""
    """Before every frame, with a slash between."""

    def outside(self, frame: str) -> str:
        """Return what a frame is called outside; one that has that name keeps it."""
        own = {MAP: self.map, ODOM: self.odom, BASE: self.base}
        start = f"{self.prefix}/" if self.prefix else ""
        if not frame or (start and frame.startswith(start)):
            return frame
        return start + own.get(frame, frame)

    def outward(self, message: Message) -> None:
        """Give a message's frames the names outside."""
        for item, key in _frames(message):
            setattr(item, key, self.outside(getattr(item, key)))

    def inward(self, message: Message) -> None:
        """Give a message's frames the graph's own names."""
        if self == FrameNames():
            return
        own = {self.map: MAP, self.odom: ODOM, self.base: BASE}
        for item, key in _frames(message):
            frame = getattr(item, key)
            if self.prefix:
                frame = frame.removeprefix(f"{self.prefix}/")
            setattr(item, key, own.get(frame, frame))


def _frames(message: Message) -> Iterator[tuple[Message, str]]:
    """Yield what has a frame in a message, and the field's name."""
    if hasattr(message, "header"):
        yield message.header, "frame_id"
    if hasattr(message, "child_frame_id"):
        yield message, "child_frame_id"
    for part in (*getattr(message, "poses", ()), *getattr(message, "transforms", ())):
        yield from _frames(part)


def map_frame(settings: Settings) -> LocalFrame:
    """Return the frame ``map`` of a scenario: ENU at the first route point, at the vehicle's
    height."""
    return LocalFrame(*first_place(settings.route), settings.route.height)


def framed(topic: Topic, frame: str, ns: int = 0) -> Message:
    """Return an empty message of a topic, in a frame and of a stamp."""
    message = topic.type()
    message.header.frame_id = frame
    set_stamp(message.header.stamp, ns)
    return message
