"""map, odom and base_link: dead reckoning goes on where a fix makes the navigator jump."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message

from isogal.inertial.rotations import matrix
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.messages.frames import BASE, MAP, ODOM, FrameNames
from isogal_ros.messages.odometry import POSE
from isogal_ros.messages.prepared import numbers_of
from isogal_ros.messages.stamps import to_ns
from ukf_fusion_node.outputs import DeadReckoning, Transforms


@pytest.fixture(scope="module")
def poses(recording) -> list:
    """Stamp and pose (7,) of every nav/odom of a run, those after fixes twice with one stamp."""
    found = []
    for message in BagReader(recording).messages():
        if message.topic == "/nav/odom":
            odometry = deserialize_message(message.data, topics.NAV_ODOM.type)
            found.append((to_ns(odometry.header.stamp), numbers_of(odometry)[POSE]))
    return found


def test_dead_reckoning_is_continuous_and_the_chain_is_the_navigator(poses) -> None:
    track, last, last_ns, shifts = DeadReckoning(), None, -1, []
    jumps = 0
    for ns, pose in poses:
        position, quaternion = pose[:3], np.roll(pose[3:], 1)
        map_odom, odom_base = track.take(ns, position, quaternion)
        whole = map_odom @ odom_base
        np.testing.assert_allclose(whole[:3, 3], position, atol=1e-6)
        np.testing.assert_allclose(whole[:3, :3], matrix(quaternion), atol=1e-9)
        if ns == last_ns:
            jumps += 1
            np.testing.assert_array_equal(odom_base[:3, 3], last)
        elif last is not None:
            assert 21.0 < np.linalg.norm(odom_base[:3, 3] - last) < 23.0  # 22 m/s, 1 s
        last, last_ns = odom_base[:3, 3], ns
        shifts.append(map_odom[:3, 3])
    assert jumps == 6
    moved = np.linalg.norm(np.diff(shifts, axis=0), axis=1)
    # what fixes have told is between map and odom, and nothing else
    corrected = np.array([a[0] == b[0] for a, b in pairwise(poses)])
    assert moved[corrected].max() > 1.0
    assert moved[~corrected].max() < 1e-6


class StandIn(SimpleNamespace):
    """For tf2_msgs, which is not among the wheels, and for the node."""

    def __init__(self, **values) -> None:
        super().__init__(frame_names=FrameNames(prefix="ship"), **values)
        self.sent: dict = {}

    def advertise(self, topic):
        return SimpleNamespace(publish=self.sent.setdefault(topic.name, []).append)

    def create_publisher(self, kind, name, qos):
        assert qos is topics.LATCHED
        return self.advertise(SimpleNamespace(name=name))


def test_what_is_published(poses, monkeypatch) -> None:
    for name, topic in (("TF", "/tf"), ("TF_STATIC", "/tf_static")):
        monkeypatch.setattr(topics, name, topics.Topic(topic, SimpleNamespace))
    settings = SimpleNamespace(
        publish_tf=True, publish_map_tf=True, sensor_frames=("gravimeter_link",)
    )
    node = StandIn(settings=settings)
    transforms = Transforms(node)
    transforms.publish(*poses[5])
    (static,) = node.sent["/tf_static"]
    (at,) = static.transforms  # those that move are renamed by the node, as all messages are
    assert (at.header.frame_id, at.child_frame_id) == ("ship/base_link", "ship/gravimeter_link")
    (moving,) = node.sent["/tf"]
    frames = [(t.header.frame_id, t.child_frame_id) for t in moving.transforms]
    assert frames == [(MAP, ODOM), (ODOM, BASE)]
    assert {to_ns(t.header.stamp) for t in moving.transforms} == {poses[5][0]}
    assert moving.transforms[1].transform.translation.x == pytest.approx(poses[5][1][0])

    settings.publish_map_tf = False  # another filter does
    other = StandIn(settings=settings)
    Transforms(other).publish(*poses[5])
    assert [t.header.frame_id for t in other.sent["/tf"][0].transforms] == [ODOM]

    silent = StandIn(settings=SimpleNamespace(publish_tf=False, sensor_frames=()))
    Transforms(silent).publish(*poses[5])
    assert silent.sent == {}
