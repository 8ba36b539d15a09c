"""Frames of the vehicle as transforms (REP-105): ``odom`` to ``base_link``, which never jumps, and
``map`` to ``odom``, which takes the jumps of fixes; and where the instruments are."""

import numpy as np
from geometry_msgs.msg import TransformStamped

from isogal.arrays import Array
from isogal.inertial.rotations import from_matrix, matrix
from isogal_ros import topics
from isogal_ros.messages.frames import BASE, MAP, ODOM
from isogal_ros.messages.mounting import Pose, pose_of
from isogal_ros.messages.stamps import set_stamp
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
