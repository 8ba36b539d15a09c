"""Nodes whose sensors are where /tf_static says."""

from contextlib import contextmanager

import pytest
import rclpy
from nav_msgs.msg import Path

from helpers.transforms import serialised
from isogal.errors import InputError
from isogal_ros import topics
from isogal_ros.graph.domain import local_context
from isogal_ros.parameters.values import node_values
from isogal_ros.topics import LATCHED, Topic
from ukf_fusion_node.node import UkfFusionNode

ASKS = "{gnss/fix: {frame: gps, from_tf: true}}"


@contextmanager
def filter_node(domain, scenario, frames):
    """A filter, in a domain where each of some transforms is published by a node of its own."""
    with local_context(domain) as context:
        nodes = [rclpy.create_node(f"broadcaster_{one}", context=context) for one in frames]
        try:
            for node, (child, placed) in zip(nodes, frames.items(), strict=True):
                publisher = node.create_publisher(Path, "/tf_static", LATCHED)
                publisher.publish(serialised({child: placed}))
            own = {"peers": ["ukf_fusion_node"], "drivers": ASKS, "tf_timeout": 2.0}
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
        with filter_node(domain, scenario, {"mast": frames["mast"]}):
            pass


def test_without_their_messages_that_is_said(domain, scenario) -> None:
    if topics.TF_STATIC is not None:
        pytest.skip("tf2_msgs is installed")
    with pytest.raises(InputError, match="needs the package tf2_msgs"):  # noqa: SIM117
        with filter_node(domain, scenario, {}):
            pass
