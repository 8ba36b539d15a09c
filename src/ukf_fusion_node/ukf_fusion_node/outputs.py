"""Messages of the filter on nav/*."""

import struct

import numpy as np
from geometry_msgs.msg import PoseStamped, TransformStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import NavSatStatus

from isogal.arrays import Array
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.protection_level import protection_level
from isogal.fusion.state import FilterState
from isogal.inertial.rotations import from_matrix, matrix
from isogal.passage import Passage
from isogal_ros import topics
from isogal_ros.messages.frames import BASE, MAP, ODOM, framed, map_frame
from isogal_ros.messages.mounting import Pose, pose_of
from isogal_ros.messages.odometry import POSE, empty_odometry, fill_state
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.prepared import Prepared, write
from isogal_ros.messages.stamped_numbers import fill_nav_covariance
from isogal_ros.messages.stamps import among, from_seconds, set_stamp, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.publishing import Publishing
from ukf_fusion_node.settings import UkfFusionSettings


class DeadReckoning:
    """What the navigator's motion adds up to without its corrections.

    From one state to the next, the motion in the vehicle's own frame is added to the pose in
    ``odom``; a correction changes the state of a stamp and adds nothing. So the pose in ``odom``
    drifts as inertial navigation does, and what fixes have told is between ``map`` and ``odom``.
    At the start both frames are the same."""

    def __init__(self) -> None:
        self._ns: int | None = None
        self._in_map: Pose = np.eye(4)
        self._in_odom: Pose = np.eye(4)

    def take(self, ns: int, position: Array, quaternion: Array) -> tuple[Pose, Pose]:
        """Take the pose of ``base_link`` in ``map`` (quaternion w first) at a stamp, a second time
        where it was corrected; return (``map`` to ``odom``, ``odom`` to ``base_link``)."""
        now = pose_of(position, matrix(quaternion))
        if self._ns is None:
            self._in_odom = now
        elif ns > self._ns:
            self._in_odom = self._in_odom @ np.linalg.inv(self._in_map) @ now
            self._in_odom[:3, :3] = matrix(from_matrix(self._in_odom[:3, :3].copy()))
        self._ns, self._in_map = ns, now
        return now @ np.linalg.inv(self._in_odom), self._in_odom


class Transforms:
    """Publishes them on /tf and /tf_static; nothing where tf2_msgs is not installed, or where the
    parameter publish_tf says so."""

    def __init__(self, node: GraphNode[UkfFusionSettings]) -> None:
        self._publisher: Publishing | None = None
        if topics.TF is None or topics.TF_STATIC is None or not node.settings.publish_tf:
            return
        self._track, self._type = DeadReckoning(), topics.TF.type
        self._messages = transform(MAP, ODOM), transform(ODOM, BASE)
        self._first = 0 if node.settings.publish_map_tf else 1
        self._publisher = node.advertise(topics.TF)
        self._static = node.create_publisher(
            topics.TF_STATIC.type, topics.TF_STATIC.name, topics.LATCHED
        )
        frames = [transform(BASE, frame) for frame in node.settings.sensor_frames]
        message = topics.TF_STATIC.type(transforms=frames)
        node.frame_names.outward(message)
        self._static.publish(message)

    def publish(self, ns: int, pose: Array) -> None:
        """Publish the transforms of a stamp from the pose (7,) of nav/odom."""
        if self._publisher is None:
            return
        poses = self._track.take(ns, pose[:3], pose[[6, 3, 4, 5]])
        for message, own in zip(self._messages, poses, strict=True):
            fill(message, ns, own)
        self._publisher.publish(self._type(transforms=list(self._messages[self._first :])))


def transform(parent: str, child: str) -> TransformStamped:
    """Return a transform that moves and turns nothing."""
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.transform.rotation.w = 1.0
    return message


def fill(message: TransformStamped, ns: int, pose: Pose) -> None:
    """Write a pose of the child in its parent."""
    set_stamp(message.header.stamp, ns)
    translation, q = message.transform.translation, message.transform.rotation
    translation.x, translation.y, translation.z = pose[:3, 3].tolist()
    q.w, q.x, q.y, q.z = from_matrix(pose[:3, :3].copy()).tolist()


PATH_POSES = 200
"""Kept at most; then every other one is left out, and they come half as often. All go into each
message: without end it would grow, and with it what the middleware keeps for each message that a
slow listener has not taken."""
_CDR = 4
"""Bytes ahead of a serialised message: how it is represented."""
_STAMP, _COUNT = struct.Struct("=iI"), struct.Struct("=I")


class Track:
    """Publishes what is kept of the poses from the start on and, last, the newest.

    Each pose is serialised once, not with each message: CDR aligns numbers to eight bytes at most
    from where the message begins, and a PoseStamped ends with doubles, so that one that follows
    another has the same bytes as one alone. The first follows the message's header, and is
    serialised with that.

    Parameters
    ----------
    node : GraphNode
    """

    def __init__(self, node: GraphNode[UkfFusionSettings]) -> None:
        self._interval = from_seconds(node.settings.path_interval)
        self._publisher, pose = node.advertise(topics.NAV_PATH), PoseStamped()
        pose.header.frame_id = MAP
        node.frame_names.outward(pose)
        self._pose = Prepared(pose)
        self._head, self._count_at = b"", 0
        """The message with the first pose alone, and where it says how many there are."""
        self._poses: list[bytes] = []
        """Those that are kept after the first."""
        self._newest = self._kept = -1
        """Stamps of the newest pose and of the newest that is kept, ns."""

    def extend(self, ns: int, pose: Array) -> None:
        """Take the pose (7,) of a stamp's odometry, unless there was one before, and publish the
        poses where somebody listens."""
        keep = not self._head or ns - self._kept >= self._interval
        if ns <= self._newest or not (keep or self._publisher.get_subscription_count()):
            return
        self._newest = ns
        newest = self._add(ns, pose, keep)
        if keep:
            self._kept = ns
        data = bytearray(b"".join((self._head, *self._poses, *newest)))
        _STAMP.pack_into(data, _CDR, *divmod(ns, 1_000_000_000))
        _COUNT.pack_into(data, self._count_at, 1 + len(self._poses) + len(newest))
        self._publisher.publish(bytes(data))

    def _add(self, ns: int, pose: Array, keep: bool) -> list[bytes]:
        """Keep a pose, or return it serialised."""
        if not self._head:
            first = self._pose.message
            write(first, ns, pose)
            path = topics.NAV_PATH.type(header=first.header)
            self._count_at = len(serialize_message(path)) - _COUNT.size
            path.poses = [first]
            self._head = serialize_message(path)
            return []
        write(self._pose, ns, pose)
        one = self._pose.serialised()[_CDR:]
        if not keep:
            return [one]
        if 1 + len(self._poses) >= PATH_POSES:
            del self._poses[::2]
            self._interval *= 2
        self._poses.append(one)
        return []


SHARE = 0.1
"""Of the lag, from one pass back over it to the next: each step of the navigator then costs as
much as the filter of eleven."""


class Outputs:
    """Publishers and messages; the messages are made once and overwritten."""

    def __init__(self, node: GraphNode) -> None:
        self.newest = -1
        """Stamp of the newest odometry, which may be within a step, ns; -1 = none."""
        self._frame = map_frame(node.scenario)
        self._fix, self._odom = node.advertise(topics.NAV_FIX), node.advertise(topics.NAV_ODOM)
        self._covariance = node.advertise(topics.NAV_COVARIANCE)
        self._track = Track(node)
        self._level = node.advertise(topics.PROTECTION_LEVEL)
        self._integrity = node.scenario.integrity
        self._m_odom = empty_odometry(topics.NAV_ODOM)
        self._m_fix = Prepared(framed(topics.NAV_FIX, BASE))
        self._m_covariance = Prepared(topics.NAV_COVARIANCE.type())
        self._m_level = Prepared(topics.PROTECTION_LEVEL.type())
        self._transforms = Transforms(node)

    def publish(
        self,
        ns: int,
        state: FilterState,
        angular_rate: Array,
        passage: Passage | None,
        aligned: bool,
    ) -> None:
        """Publish a state.

        Parameters
        ----------
        ns : int
            Stamp.
        state : FilterState
        angular_rate : (3,) array
            As the gyroscopes measured it, FRD, rad/s.
        passage : Passage, optional
            What has become of the error since the last fix.
        aligned : bool
            A state that is not promises nothing: it is no fix, and has no protection level, path
            or transforms.
        """
        # odometry first: a lock-step simulation goes on with it while the rest is made
        self.publish_odometry(ns, state, angular_rate, aligned)
        if aligned:
            promise, of_position = self._integrity, state.covariance[:2, :2]
            level = protection_level(of_position, promise.risk, promise.correlation_time)
            write(self._m_level, ns, level[None])
            self._level.publish(self._m_level)
        fill_nav_covariance(self._m_covariance, ns, state.batch_prior, passage)
        self._covariance.publish(self._m_covariance)
        status = NavSatStatus.STATUS_FIX if aligned else NavSatStatus.STATUS_NO_FIX
        latitude, longitude, height = state.position.tolist()
        covariance = state.covariance[:3, :3]
        fill_fix(self._m_fix, ns, latitude, longitude, height, covariance, status)
        self._fix.publish(self._m_fix)
        if aligned:
            self._track.extend(ns, self._m_odom.numbers[POSE])

    def publish_odometry(
        self, ns: int, state: FilterState, angular_rate: Array, aligned: bool = True
    ) -> None:
        """Publish a state on nav/odom and /tf only; see `publish`."""
        self.newest = ns
        fill_state(self._m_odom, ns, self._frame, state, angular_rate)
        self._odom.publish(self._m_odom)
        if aligned:
            self._transforms.publish(ns, self._m_odom.numbers[POSE])


class Smoothed:
    """Publishes the states of the past on nav/smoothed, as all data up to `fusion.lag` later have
    them: each once, between one and 1 + `SHARE` lags after its stamp."""

    def __init__(self, node: GraphNode) -> None:
        self.lag = node.scenario.fusion.lag
        """s; 0 = nothing is published."""
        self._frame, self._reached = map_frame(node.scenario), -np.inf
        self._stamps: list[int] = []
        """Of the steps after that time, ns."""
        self._message = empty_odometry(topics.SMOOTHED)
        self._publisher = node.advertise(topics.SMOOTHED) if self.lag > 0.0 else None

    def publish(self, ns: int, navigator: InertialNavigator | None) -> None:
        """Publish the states that are a lag old, if it is time to look back; a step has ended at a
        stamp (ns)."""
        if self._publisher is None:
            return
        self._stamps.append(ns)
        if navigator is None:
            return
        until = navigator.time - self.lag
        if until < self._reached + SHARE * self.lag:
            return
        stamps, rates = navigator.samples(self._reached, until)
        each_ns = among(stamps.tolist(), self._stamps)
        self._stamps = [ns for ns in self._stamps if to_seconds(ns) > until]
        self._reached = until
        if not len(stamps):
            return
        states = navigator.smoothed(stamps)
        for stamp, rate, state in zip(each_ns, rates, states, strict=True):
            fill_state(self._message, stamp, self._frame, state, rate)
            self._publisher.publish(self._message)

    def begin_anew(self) -> None:
        """Publish what comes after a reset, whatever its stamps are."""
        self._reached = -np.inf
        self._stamps.clear()
