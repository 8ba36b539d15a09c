"""The navigator's latest states by stamp, decoded only where a scan needs them."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from rclpy.serialization import deserialize_message

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.inertial.error_state import Estimate, batch_difference
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.messages.convert import (
    map_frame,
    read_covariance,
    read_nav_covariance,
    read_position,
    read_velocity,
)
from isogal_ros.messages.odometry import quaternion
from isogal_ros.messages.stamps import from_seconds, peek_ns, peek_numbers_ns, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import BadMessageError

KEPT = 1024
"""Stamps kept: at 1 Hz a reading may come 17 minutes late."""
ROUNDING = 1e-7
"""m; what degrees and back may leave where nothing moved."""


@dataclass(frozen=True, slots=True, eq=False)
class NavSample:
    """What the navigator said at one stamp."""

    ns: int
    latitude: float
    longitude: float
    """rad."""
    height: float
    velocity: Array
    """(3,) NED, m/s."""
    attitude: Array
    """(3, 3) FRD to NED."""
    covariance: Array
    """(7, 7) of a batch's states (`isogal.inertial.error_state`); (4, 4) where the attitude's is
    not known."""
    height_variance: float

    def estimate(self, attitude: tuple[float, ...]) -> Estimate:
        """Return position and velocity with an attitude in place of its own."""
        position = np.array([self.latitude, self.longitude, self.height])
        return Estimate(position, self.velocity, np.array(attitude))


@dataclass(frozen=True, slots=True, eq=False)
class Jump:
    """What a fix did to the navigator: after minus before."""

    ns: int
    change: Array
    """(7,) in a batch's states (`isogal.inertial.error_state`)."""


@dataclass(slots=True)
class _Stamp:
    """Serialised messages of one stamp in the order they came: the first of each topic is before
    any fix."""

    fix: list[bytes] = field(default_factory=list)
    odom: list[bytes] = field(default_factory=list)
    covariance: bytes | None = None
    pairs: int = 0


class NavBuffer:
    """Collects ``nav/fix``, ``nav/odom`` and ``nav/covariance`` for a node.

    A further pair of the same stamp is the navigator after a fix. Messages are kept serialised,
    since only one in ten is ever looked at.

    Parameters
    ----------
    node : GraphNode
        Listens.
    scenario : Scenario
        Says where the frame ``map`` is, and the navigator's rate.
    arrived : callable
        Called without arguments whenever another stamp may have become known.
    """

    def __init__(self, node: GraphNode, scenario: Scenario, arrived: Callable[[], None]) -> None:
        self.jumps: list[Jump] = []
        """Jumps seen, oldest first; whoever uses them takes them out."""
        self._newest = -1
        self._newest_covariance = -1
        self._frame = map_frame(scenario)
        self._interval = from_seconds(1.0 / scenario.imu.rate)
        self._stamps: dict[int, _Stamp] = {}
        self._arrived = arrived
        node.listen(topics.NAV_FIX, lambda data: self._take(data, True), raw=True)
        node.listen(topics.NAV_ODOM, lambda data: self._take(data, False), raw=True)
        self._extra = node.listen(topics.NAV_COVARIANCE, self._take_covariance, raw=True)

    def at(self, ns: int) -> NavSample | None:
        """Return the state at a stamp as it was before any fix of that stamp, or None while it may
        still come.

        A stamp between two states is reached from the one before with its velocity.

        Raises
        ------
        BadMessageError
            The navigator's messages of that time are missing or cannot be used.
        """
        stamp = self._stamps.get(ns)
        if stamp is not None and stamp.pairs:
            late = ns < self._newest_covariance or ns + 5 * self._interval < self._newest
            if stamp.covariance is None and not late and self._extra.get_publisher_count():
                return None
            return self._decode(ns, stamp)
        if ns >= self._newest:
            return None
        before = max(
            (time for time, item in self._stamps.items() if time < ns and item.pairs), default=None
        )
        if before is None or ns - before > 2 * self._interval:
            raise BadMessageError(f"the navigator said nothing about {to_seconds(ns):.3f} s")
        return _moved(self._decode(before, self._stamps[before]), ns)

    def take_jumps(self, before: int) -> list[Jump]:
        """Take out the jumps with stamps earlier than `before` (ns), oldest first."""
        taken = [jump for jump in self.jumps if jump.ns < before]
        self.jumps = [jump for jump in self.jumps if jump.ns >= before]
        return taken

    def _stamp(self, ns: int) -> _Stamp:
        found = self._stamps.get(ns)
        if found is None:
            if len(self._stamps) >= KEPT:
                oldest = next(iter(self._stamps))
                if ns < oldest:
                    raise BadMessageError(
                        f"stamp {to_seconds(ns):.3f} s is older than all that are kept"
                    )
                del self._stamps[oldest]
            found = self._stamps[ns] = _Stamp()
        return found

    def _take(self, data: bytes, is_fix: bool) -> None:
        ns = peek_ns(data)
        stamp = self._stamp(ns)
        (stamp.fix if is_fix else stamp.odom).append(data)
        while stamp.pairs < min(len(stamp.fix), len(stamp.odom)):
            stamp.pairs += 1
            if stamp.pairs > 1:
                self._note_jump(ns, stamp)
        if stamp.pairs == 1:
            self._newest = max(self._newest, ns)
        self._arrived()

    def _take_covariance(self, data: bytes) -> None:
        try:
            ns = peek_numbers_ns(data)
        except ValueError as error:
            raise BadMessageError(str(error)) from None
        stamp = self._stamp(ns)
        if stamp.covariance is None:
            stamp.covariance = data
            self._newest_covariance = max(self._newest_covariance, ns)
            self._arrived()

    def _note_jump(self, ns: int, stamp: _Stamp) -> None:
        after = self._state(stamp, stamp.pairs - 1)
        before = self._state(stamp, stamp.pairs - 2)
        # only the rotation between the two attitudes matters
        turn = quaternion(after.attitude @ before.attitude.T)
        change = batch_difference(after.estimate(turn), before.estimate((1.0, 0.0, 0.0, 0.0)))
        if np.abs(change[:2]).max() > ROUNDING:
            self.jumps.append(Jump(ns, change))

    def _state(self, stamp: _Stamp, index: int) -> NavSample:
        fix = deserialize_message(stamp.fix[index], topics.NAV_FIX.type)
        odom = deserialize_message(stamp.odom[index], topics.NAV_ODOM.type)
        latitude, longitude, height = read_position(fix)
        velocity, of_velocity, attitude = read_velocity(odom, self._frame, latitude, longitude)
        of_position = read_covariance(fix)
        covariance = np.zeros((4, 4))
        covariance[:2, :2], covariance[2:, 2:] = of_position[:2, :2], of_velocity[:2, :2]
        return NavSample(
            peek_ns(stamp.fix[index]),
            latitude,
            longitude,
            height,
            velocity,
            attitude,
            covariance,
            float(of_position[2, 2]),
        )

    def _decode(self, ns: int, stamp: _Stamp) -> NavSample:
        sample = self._state(stamp, 0)
        if stamp.covariance is None:
            return sample
        message = deserialize_message(stamp.covariance, topics.NAV_COVARIANCE.type)
        return replace(sample, covariance=read_nav_covariance(message))


def _moved(sample: NavSample, ns: int) -> NavSample:
    step = to_seconds(ns - sample.ns)
    north, east = metres_per_radian(sample.latitude, sample.height)
    return replace(
        sample,
        ns=ns,
        latitude=sample.latitude + step * float(sample.velocity[0] / north),
        longitude=sample.longitude + step * float(sample.velocity[1] / east),
    )
