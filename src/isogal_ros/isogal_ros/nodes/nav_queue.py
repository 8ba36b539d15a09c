"""The navigator's latest states by stamp, decoded only where a scan needs them, and the items that
wait for them."""

from bisect import insort
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from sensor_msgs.msg import NavSatStatus

from isogal.arrays import Array
from isogal.earth.frames import LocalFrame
from isogal.fusion.outage import HELD
from isogal.inertial.dead_reckoning import dead_reckoned
from isogal.inertial.error_state import Estimate, batch_difference
from isogal.inertial.rotations import from_matrix
from isogal.passage import Passage
from isogal.sensors.reduction import Reduction, State, reduction_variance
from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import FRD_FLU, map_frame
from isogal_ros.messages.odometry import read_odometry, read_velocity
from isogal_ros.messages.position import read_covariance, read_position
from isogal_ros.messages.prepared import decoded, peek_ns
from isogal_ros.messages.stamped_numbers import peek_numbers_ns, read_nav_covariance
from isogal_ros.messages.stamps import from_seconds, to_ns, to_seconds
from isogal_ros.nodes.base import GraphNode

_NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True, eq=False)
class NavSample:
    """What the navigator said at one stamp."""

    ns: int
    position: Array
    """(3,) latitude rad, longitude rad, height m."""
    velocity: Array
    """(3,) NED, m/s."""
    attitude: Array
    """(3, 3) FRD to NED."""
    covariance: Array
    """(7, 7) of a batch's states (`isogal.inertial.error_state`); (4, 4) where the attitude's is
    not known."""
    height_variance: float
    """m²."""
    passage: Passage | None = None
    """What has become of the error since a fix; None = nothing is said."""
    turn: Array | None = None
    """(3,) angular rate relative to the Earth, FRD, rad/s; None = not known."""
    aligned: bool = True
    """Whether the navigator is aligned: one that is not says where it may be, and promises
    nothing."""

    @property
    def sensor(self) -> State:
        """Where a sensor is, and how it moves."""
        latitude, longitude, height = self.position
        north, east, _ = self.velocity
        return State(latitude, longitude, height, north, east, self.attitude, self.turn)

    def variance_by(self, reduction: Reduction) -> float:
        """Return the variance that the navigator's uncertainty puts into a reading by its
        reduction, in the unit of the map squared."""
        covariance = self.covariance[:4, :4]
        return float(reduction_variance(reduction, self.sensor, covariance, self.height_variance))


def read_nav(fix: bytes, odom: bytes, frame: LocalFrame) -> NavSample:
    """Return the state that serialised messages on nav/fix and nav/odom say, in the frame ``map``;
    raises BadMessageError where one cannot be used."""
    where, motion = decoded(fix, topics.NAV_FIX.type), read_odometry(odom)
    position, of_position = read_position(where), read_covariance(where)
    velocity, of_velocity, attitude = read_velocity(motion, frame, *position[:2])
    covariance = np.zeros((4, 4))
    covariance[:2, :2], covariance[2:, 2:] = of_position[:2, :2], of_velocity[:2, :2]
    return NavSample(
        to_ns(where.header.stamp),
        np.array(position),
        velocity,
        attitude,
        covariance,
        float(of_position[2, 2]),
        turn=FRD_FLU * motion.turn_rate,
        aligned=where.status.status != NavSatStatus.STATUS_NO_FIX,
    )


def moved(sample: NavSample, ns: int) -> NavSample:
    """Return the state a moment later or earlier, at another stamp."""
    seconds = to_seconds(ns - sample.ns)
    position = dead_reckoned(sample.position, sample.velocity, seconds)
    return replace(sample, ns=ns, position=position)


def difference(after: NavSample, before: NavSample) -> Array:
    """Return (7,) the difference of two states in a batch's states."""
    # only the rotation between the two attitudes counts
    turn = from_matrix(after.attitude @ before.attitude.T)
    return batch_difference(
        Estimate(after.position, after.velocity, turn),
        Estimate(before.position, before.velocity, _NO_TURN),
    )


LONGEST = 1024
"""Items that wait at most."""
KEPT = 1024
"""Stamps kept: at 1 Hz a reading may come 17 minutes late."""
LATE = 5
"""Steps of the navigator after which nothing of a stamp is expected any more."""
REPEATED = 1024
"""Messages of one topic kept of one stamp: in retrodiction one for each fix of a batch. Also the
number of changes kept where nobody takes them out."""
UNANSWERED = 10.0
"""s of wall time that an item waits before that is said."""
ROUNDING = 1e-7
"""m; what degrees and back may leave where nothing moved."""


Item = TypeVar("Item")


class Jump(NamedTuple):
    """What a fix did to the navigator."""

    ns: int
    """Stamp."""
    change: Array
    """After minus before, (7,) in a batch's states (`isogal.inertial.error_state`)."""


class Gap(NamedTuple):
    """A time of which the navigator said nothing, longer than `HELD`."""

    begin: int
    """Stamps of the states before and after it, ns."""
    ns: int


@dataclass(slots=True)
class _Stamp:
    """Serialised messages of one stamp in the order they came: the first of each topic is before
    any fix."""

    fix: list[bytes] = field(default_factory=list)
    odom: list[bytes] = field(default_factory=list)
    covariance: bytes | None = None
    pairs: int = 0


class NavQueue(Generic[Item]):
    """Collects ``nav/fix``, ``nav/odom`` and ``nav/covariance`` for a node, and hands on each of
    its items, in order of time, once the navigator's state of their stamp is there. Where too many
    wait, the oldest is handed on without.

    A further pair of fix and odometry of the same stamp is the navigator after a fix. Messages are
    kept serialised, since only one in ten is needed.

    Parameters
    ----------
    node : GraphNode
        Listens to the navigator and tells its health.
    handle : callable
        Called with stamp (ns), item, and the navigator's state; None = it said nothing usable of
        that stamp.
    """

    def __init__(
        self, node: GraphNode, handle: Callable[[int, Item, NavSample | None], None]
    ) -> None:
        self.waiting: list[tuple[int, int, Item]] = []
        """Stamps, ranks and items, in order."""
        self._health, self._handle = node.health, handle
        self.changes: deque[Jump | Gap] = deque(maxlen=REPEATED)
        """Jumps and gaps seen, oldest first; whoever uses them takes them out."""
        self.newest = -1
        """Stamp of the newest state, ns; -1 = none."""
        self._frame = map_frame(node.scenario)
        self._interval = from_seconds(1.0 / node.scenario.navigation_rate)
        self._stamps: dict[int, _Stamp] = {}
        self._alone: deque[int] = deque(maxlen=KEPT)
        """Stamps of odometry that no fix has come for: within a step of the navigator's there is
        none."""
        node.listen(topics.NAV_FIX, lambda data: self._take(data, True), raw=True)
        node.listen(topics.NAV_ODOM, lambda data: self._take(data, False), raw=True)
        self._extra = node.listen(topics.NAV_COVARIANCE, self._take_covariance, raw=True)
        self._monotonic, self._first_in_line = node.monotonic, (-1, 0.0)
        node.watch("waiting for the navigator", self._unanswered)

    def put(self, ns: int, item: Item, rank: int = 0) -> None:
        """Take an item of a stamp, which follows those of the same stamp and no higher rank."""
        insort(self.waiting, (ns, rank, item), key=lambda one: one[:2])
        self.arrived()
        self._process()

    def arrived(self) -> None:
        """Look at what has come: the navigator has gone on, or an item is there."""

    def in_turn(self, ns: int) -> bool:
        """Whether no item of an earlier time than a stamp can come any more."""
        return True

    def begin_anew(self) -> None:
        """Forget all that has come: time may begin anew."""
        for kept in (self.waiting, self.changes, self._stamps, self._alone):
            kept.clear()
        self.newest = -1

    def _unanswered(self) -> str | None:
        """Say that the navigator's state of a stamp does not come; None = nothing waits for
        long."""
        first, now = (self.waiting[0][0] if self.waiting else -1), self._monotonic()
        if first != self._first_in_line[0]:
            self._first_in_line = first, now
        if first < 0 or now - self._first_in_line[1] < UNANSWERED:
            return None
        at = "has not come" if self.newest < 0 else f"is at {to_seconds(self.newest):.3f} s"
        return (
            f"{len(self.waiting)} readings wait for nav/* of {to_seconds(first):.3f} s, which {at}"
        )

    def _process(self) -> None:
        """Deal with the waiting items as far as the navigator's states reach."""
        while self.waiting:
            ns, _, item = self.waiting[0]
            if not self.in_turn(ns):
                return
            try:
                nav = self.at(ns)
                if nav is None and len(self.waiting) <= LONGEST:
                    return
                if nav is None:
                    raise BadMessageError(f"more than {LONGEST} readings wait for the navigator")
            except BadMessageError as error:
                self._health.drop(topics.NAV_ODOM.name, str(error))
                nav = None
            del self.waiting[0]
            self._handle(ns, item, nav)
            self._health.stamp = ns

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
            late = ns + LATE * self._interval < self.newest
            if stamp.covariance is None and not late and self._extra.get_publisher_count():
                return None
            return self._decode(stamp)
        if ns >= self.newest:
            return None
        before = max(
            (time for time, item in self._stamps.items() if time < ns and item.pairs), default=None
        )
        if before is None or ns - before > 2 * self._interval:
            raise BadMessageError(f"the navigator said nothing about {to_seconds(ns):.3f} s")
        return moved(self._decode(self._stamps[before]), ns)

    def take_changes(self, until: int) -> Iterator[Jump | tuple[NavSample, NavSample]]:
        """Take out the jumps with stamps earlier than `until` (ns) and the gaps that end by then,
        oldest first: of a gap the states before and after it, where they are still there."""
        while self.changes:
            change = self.changes[0]
            if change.ns > until or (change.ns == until and isinstance(change, Jump)):
                return
            self.changes.popleft()
            if isinstance(change, Jump):
                yield change
            elif all(ns in self._stamps for ns in change):
                before, after = (self._decode(self._stamps[ns]) for ns in change)
                yield before, after

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
        if is_fix:
            self._forget_alone(ns)
        elif ns not in self._stamps:
            self._alone.append(ns)
        stamp = self._stamp(ns)
        kept = stamp.fix if is_fix else stamp.odom
        if len(kept) >= REPEATED:
            raise BadMessageError(f"more than {REPEATED} messages of {to_seconds(ns):.3f} s")
        kept.append(data)
        while stamp.pairs < min(len(stamp.fix), len(stamp.odom)):
            stamp.pairs += 1
            if stamp.pairs > 1:
                self._note_jump(ns, stamp)
        if stamp.pairs == 1 and ns > self.newest:
            if 0 <= self.newest < ns - self._interval - from_seconds(HELD):
                self.changes.append(Gap(self.newest, ns))
            self.newest = ns
            self.arrived()
        if self.waiting:
            self._process()

    def _forget_alone(self, ns: int) -> None:
        """Forget odometry from long before a fix (its stamp) that none has come for."""
        while self._alone and self._alone[0] < ns - LATE * self._interval:
            stamp = self._alone.popleft()
            if stamp in self._stamps and not self._stamps[stamp].fix:
                del self._stamps[stamp]

    def _take_covariance(self, data: bytes) -> None:
        ns = peek_numbers_ns(data)
        stamp = self._stamp(ns)
        if stamp.covariance is None:
            stamp.covariance = data
            if self.waiting:
                self._process()

    def _note_jump(self, ns: int, stamp: _Stamp) -> None:
        after, before = self._state(stamp, stamp.pairs - 1), self._state(stamp, stamp.pairs - 2)
        change = difference(after, before)
        if np.abs(change[:2]).max() > ROUNDING:
            self.changes.append(Jump(ns, change))

    def _state(self, stamp: _Stamp, index: int) -> NavSample:
        return read_nav(stamp.fix[index], stamp.odom[index], self._frame)

    def _decode(self, stamp: _Stamp) -> NavSample:
        sample = self._state(stamp, 0)
        if stamp.covariance is None:
            return sample
        message = decoded(stamp.covariance, topics.NAV_COVARIANCE.type)
        covariance, passage = read_nav_covariance(message)
        return replace(sample, covariance=covariance, passage=passage)
