"""The solution of an INS in place of samples of an IMU, and what is found wrong with it."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from geometry_msgs.msg import TwistWithCovarianceStamped
from sensor_msgs.msg import NavSatFix

from isogal.arrays import Array
from isogal.fusion.state import FilterState
from isogal.inertial.inverse import (
    InverseStrapdown,
    NothingFeltError,
    level_attitude,
)
from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import map_frame
from isogal_ros.messages.ins_solution import (
    fill_error,
    read_position_and_velocity,
    read_solution,
)
from isogal_ros.messages.prepared import peek_ns
from isogal_ros.messages.stamps import from_seconds, to_ns, to_seconds
from isogal_ros.nodes.base import GraphNode
from ukf_fusion_node.navigation import Navigation

LONGEST = 600.0
"""s without solutions that are filled in; after longer it may be another INS, or one that was
started anew."""
WAITING = 1000
"""Positions and velocities that wait for the others of their stamps at most."""


Part: TypeAlias = NavSatFix | TwistWithCovarianceStamped
Solution: TypeAlias = bytes | dict[type[Part], Part]
"""A serialised Odometry, or position and velocity of one stamp, which take its place."""
Sample = tuple[int, Array, Array, float]
"""Stamp of its end (ns), specific force and angular rate (3,), and its interval, s."""


class Solutions:
    """Listens to an INS and says what it felt.

    Parameters
    ----------
    node : GraphNode
        Its scenario says what the INS gives.
    preintegrated : bool
        As the filter's model has it.
    hold : callable
        Takes stamp (ns) and message of each whole solution.
    """

    def __init__(
        self, node: GraphNode, preintegrated: bool, hold: Callable[[int, Solution], None]
    ) -> None:
        ins = node.scenario.ins
        self._frame, self._hold = map_frame(node.scenario), hold
        self._inverse = InverseStrapdown(ins.jump, LONGEST, preintegrated)
        self._error, self._m_error = node.advertise(topics.INS_ERROR), topics.INS_ERROR.type()
        self._parts: dict[int, dict[type[Part], Part]] = {}
        """Position or velocity by stamp, that waits for the other."""
        self._newest = -1
        """Stamp of the newest solution."""
        if ins.attitude:
            node.listen(topics.INS_SOLUTION, lambda data: hold(peek_ns(data), data), raw=True)
        else:
            node.listen(topics.INS_SOLUTION_FIX, self._take)
            node.listen(topics.INS_SOLUTION_VELOCITY, self._take)

    def _take(self, message: Part) -> None:
        """Hand on position and velocity of a stamp when both have come."""
        ns = to_ns(message.header.stamp)
        parts = self._parts.setdefault(ns, {})
        parts[type(message)] = message
        if len(parts) == 2:
            self._hold(ns, self._parts.pop(ns))
        elif len(self._parts) > WAITING:
            del self._parts[min(self._parts)]

    def _read(self, message: Solution) -> Array:
        """Return the solution (10,) of a message; raises BadMessageError where it is none."""
        if isinstance(message, bytes):
            return read_solution(message, self._frame)
        parts = message[NavSatFix], message[TwistWithCovarianceStamped]
        place, velocity = read_position_and_velocity(*parts)
        last = self.last
        attitude = level_attitude(velocity[None], None if last is None else last[6:])[0]
        return np.concatenate([place, velocity, attitude])

    @property
    def last(self) -> Array | None:
        """The newest solution (10,) that was taken; None = none yet."""
        return self._inverse.last

    def samples(self, ns: int, message: Solution, navigation: Navigation) -> list[Sample]:
        """Return what the INS felt since its last solution, by a message of a stamp (ns), which
        must be later than the newest of the navigation; raises BadMessageError where it cannot be
        used, or does not say that."""
        solution = self._read(message)
        navigation.require_later(ns)
        if navigation.navigator is not None:
            navigation.time_jumps.check(ns, navigation.ns)
        try:
            found = self._inverse.take(to_seconds(ns), solution)
        except NothingFeltError as error:
            raise BadMessageError(str(error)) from None
        self._newest = ns
        ends = np.cumsum([one.interval for one in found][::-1])[::-1] - [x.interval for x in found]
        return [
            (ns - from_seconds(float(after)), one.force, one.rate, one.interval)
            for after, one in zip(ends, found, strict=True)
        ]

    def publish_error(self, ns: int, state: FilterState) -> None:
        """Publish what is wrong with the newest solution, if a state is of its stamp (ns)."""
        if self.last is not None and ns == self._newest:
            estimate = np.concatenate(state.estimate)
            fill_error(self._m_error, ns, self.last, estimate, state.covariance)
            self._error.publish(self._m_error)
