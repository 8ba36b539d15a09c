"""Arms and mountings of sensors from static transforms."""

from contextlib import contextmanager, suppress

import numpy as np
import pytest
import rclpy
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Path

from helpers.bag_writing import begin
from helpers.transforms import serialised
from isogal.errors import InputError
from isogal.inertial.rotations import from_angles, matrix
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.domain import local_context
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.drivers import Driver, Entrance
from isogal_ros.messages.frames import FrameNames
from isogal_ros.messages.mounting import mounted, placed, read_transforms
from isogal_ros.parameters.values import node_values
from isogal_ros.topics import LATCHED, Topic
from ukf_fusion_node.node import UkfFusionNode

VEHICLE = {
    "imu_link": ("base_link", (0.5, 0.0, 0.2), (180.0, 0.0, 90.0)),
    "mast": ("base_link", (1.0, 0.0, 3.0), (0.0, 0.0, 90.0)),
    "gps": ("mast", (2.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
    "dvl": ("base_link", (-1.0, 0.5, -2.0), (0.0, 10.0, 45.0)),
    "circle": ("circle", (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
}
"""Parent, place and roll, pitch, yaw (deg) of each frame."""


def look(_enough):
    return read_transforms(serialised(VEHICLE))


def entrance(names=FrameNames(), **drivers) -> Entrance:  # noqa: B008
    entries = {
        name.replace("__", "/"): Driver(**{"from_tf": True} | one) for name, one in drivers.items()
    }
    return placed(Entrance(entries, names), look)


def test_transforms_are_read_in_either_byte_order() -> None:
    one, other = (read_transforms(serialised(VEHICLE, order)) for order in "<>")
    assert one.keys() == other.keys() == VEHICLE.keys()
    for child, (parent, place, angles) in VEHICLE.items():
        assert one[child].parent == other[child].parent == parent
        np.testing.assert_allclose(one[child].pose[:3, 3], place)
        np.testing.assert_allclose(one[child].pose, other[child].pose)
        wanted = matrix(from_angles(*np.radians(angles)))
        np.testing.assert_allclose(one[child].pose[:3, :3], wanted, atol=1e-12)


@pytest.mark.parametrize(
    ("topic", "one", "words"),
    [
        ("gnss/fix", {"frame": "gps"}, r"drivers.gnss/fix.frame: has no effect.*from_tf: true"),
        ("altimeter/points", {"frame": "dvl", "from_tf": True}, "are not turned"),
        ("altimeter/points", {"rotation": (0.0, 0.0, 90.0)}, "must be those of 'base_link'"),
    ],
)
def test_what_an_entry_asks_for_in_vain_is_refused(topic, one, words) -> None:
    with pytest.raises(InputError, match=words):
        placed(Entrance({topic: Driver(**one)}), look)


@settings(max_examples=25)
@given(st.data())
def test_what_is_cut_off_or_damaged_is_no_transform_or_another(data) -> None:
    whole = bytearray(serialised(VEHICLE))
    with pytest.raises(BadMessageError):
        read_transforms(bytes(whole[: data.draw(st.integers(0, len(whole) - 1))]))
    for at in data.draw(st.lists(st.integers(0, len(whole) - 1), max_size=9)):
        whole[at] = data.draw(st.integers(0, 255))
    with suppress(BadMessageError):
        for link in read_transforms(bytes(whole)).values():
            assert np.isfinite(link.pose).all()


def test_an_entry_has_what_the_chain_of_transforms_says_unless_it_says_it_itself() -> None:
    found = entrance(imu__data_raw={"frame": "imu_link"}, gnss__fix={"frame": "gps"}).drivers
    np.testing.assert_allclose(found["imu/data_raw"].rotation, (180.0, 0.0, 90.0), atol=1e-9)
    np.testing.assert_allclose(found["gnss/fix"].translation, (1.0, 2.0, 4.0), atol=1e-12)
    assert found["gnss/fix"].rotation == (0.0, 0.0, 0.0)  # a position has no axes of a sensor
    said = {"frame": "imu_link", "rotation": (0.0, 0.0, 1.0), "translation": (9.0, 9.0, 9.0)}
    one = entrance(imu__data_raw=said).drivers["imu/data_raw"]
    assert (one.rotation, one.translation) == (said["rotation"], said["translation"])


def test_arms_are_from_the_inertial_sensors(scenario) -> None:
    own = scenario(
        "gnss.available=[[0, 60]]",
        "positions=[{name: usbl, sigma: 5}, {name: radar, sigma: 5}]",
        "velocity.kind=dvl",
        "velocity.lever_arm=[7, 0, 0]",
        "velocities=[{name: second, kind: dvl}]",
    )
    found = entrance(
        imu__data_raw={"frame": "imu_link"},
        gnss__fix={"frame": "gps"},
        velocity__data_raw={"frame": "dvl"},
        velocity__second__data_raw={"frame": "dvl"},
        position__radar__fix={"frame": "mast"},
    )
    made = mounted(own, found.drivers)
    assert made.gnss.lever_arm == pytest.approx((0.5, -2.0, -3.8))
    assert made.positions[1].lever_arm == pytest.approx((0.5, 0.0, -2.8))
    assert made.positions[0].lever_arm == (0.0, 0.0, 0.0)
    assert made.velocities[0].lever_arm == pytest.approx((-1.5, -0.5, 2.2))
    assert made.velocity.lever_arm == (7.0, 0.0, 0.0)  # its own key wins
    # what is mounted already is not mounted again
    assert mounted(made, found.drivers) == made
    of_ins = {"ins/solution": found.drivers["imu/data_raw"], "gnss/fix": found.drivers["gnss/fix"]}
    assert mounted(own, of_ins).gnss == made.gnss


@pytest.mark.parametrize(
    ("names", "frame", "words"),
    [
        (FrameNames(base="hull"), "gps", "no transform from 'hull' to 'gps'"),
        (FrameNames(), "gsp", "to 'gsp' on /tf_static, which has circle, dvl, gps, i"),
        (FrameNames(), "circle", "no transform"),
    ],
    ids=["names outside", "not there", "in a circle"],
)
def test_frames_that_are_not_connected(names, frame, words) -> None:
    with pytest.raises(InputError, match=words):
        entrance(names, gnss__fix={"frame": frame})


def test_those_of_a_recording_count_in_its_replay(scenario, tmp_path) -> None:
    writer = begin(tmp_path / "bag")
    writer.add_topic("/tf_static", "nav_msgs/msg/Path", [], "")  # for want of its own
    writer.write("/tf_static", serialised(VEHICLE), 0, 0)
    writer.close()
    options = ["gravimeter/data_raw.frame=mast", "gravimeter/data_raw.from_tf=true"]
    reader = BagReader(tmp_path / "bag", drivers=options)
    assert mounted(scenario(), reader.entrance.drivers).gravimeter.lever_arm == (1.0, 0.0, -3.0)
    # what a recorder keeps of it has no need to look again
    assert placed(Entrance.of(reader.entrance.text(), {}), None) == reader.entrance


ASKS = "{gnss/fix: {frame: gps, from_tf: true}}"


@contextmanager
def filter_node(domain, scenario, frames, patience=2.0):
    """A filter, in a domain where each of some transforms is published by a node of its own."""
    with local_context(domain) as context:
        nodes = [rclpy.create_node(f"broadcaster_{one}", context=context) for one in frames]
        try:
            for node, (child, placed) in zip(nodes, frames.items(), strict=True):
                publisher = node.create_publisher(Path, "/tf_static", LATCHED)
                publisher.publish(serialised({child: placed}))
            own = {"peers": ["ukf_fusion_node"], "drivers": ASKS, "tf_timeout": patience}
            values = node_values(scenario("gnss.available=[[0, 60]]"), own, UkfFusionNode.sections)
            nodes.append(UkfFusionNode("ukf_fusion_node", values=values, context=context))
            yield nodes[-1]
        finally:
            for node in nodes:
                node.destroy_node()


def test_the_arm_is_what_several_broadcasters_say(domain, scenario, monkeypatch) -> None:
    # in place of the class of its messages, which the wheels do not have
    monkeypatch.setattr(topics, "TF_STATIC", Topic("/tf_static", Path, single=False))
    level = (0.0, 0.0, 0.0)
    frames = {"mast": ("base_link", (1.0, 2.0, 3.0), level), "gps": ("mast", (0, 0, 1.0), level)}
    with filter_node(domain, scenario, frames) as node:
        assert node.scenario.gnss.lever_arm == (1.0, -2.0, -4.0)
    with pytest.raises(InputError, match="no transform from 'base_link' to 'gps' on /tf_static"):  # noqa: SIM117
        with filter_node(domain, scenario, {"mast": frames["mast"]}, 0.1):
            pass


def test_without_their_messages_that_is_said(domain, scenario) -> None:
    if topics.TF_STATIC is not None:
        pytest.skip("tf2_msgs is installed")
    with pytest.raises(InputError, match="needs the package tf2_msgs"):  # noqa: SIM117
        with filter_node(domain, scenario, {}):
            pass
