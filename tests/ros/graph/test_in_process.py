"""The graph in one process ends as it should, whatever fails."""

import errno
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from std_srvs.srv import Trigger

from helpers.node_bench import run_here
from helpers.recordings import collect
from isogal_ros import topics
from isogal_ros.bags.writer import BagWriter
from isogal_ros.graph.domain import free_domains, quiet_node
from isogal_ros.graph.plan import GraphError, Plan
from isogal_ros.graph.running import Progress, run_in_process
from isogal_ros.messages.frames import MAP
from isogal_ros.nodes.signals import Interrupt
from isogal_ros.nodes.spin import make_executor


def test_a_recorder_that_fails_fails_the_run(scenario, tmp_path, monkeypatch) -> None:
    write = BagWriter.write

    def full(self, *words) -> None:
        if self.messages == 300:
            raise OSError(errno.ENOSPC, "No space left on device")
        write(self, *words)

    monkeypatch.setattr(BagWriter, "write", full)
    with pytest.raises(GraphError, match=r"^isogal_recorder: .* No space left on device"):
        run_here(scenario(), tmp_path / "bag")
    assert len(collect(tmp_path / "bag").truth) > 10


def test_others_hear_it_and_are_heard(scenario) -> None:
    """Its nodes hear each other past the middleware; others by it, as from processes."""
    heard: list[Odometry] = []
    asked = []
    plan = Plan(scenario("route.duration=120.0"), None, rate=40.0)
    with ExitStack() as stack:
        domain = next(free_domains(stack))
        outside = stack.enter_context(quiet_node("outside", domain))
        executor = make_executor(outside.context)
        stack.callback(executor.shutdown)
        executor.add_node(outside)
        outside.create_subscription(Odometry, topics.NAV_ODOM.name, heard.append, topics.LOSSLESS)
        placed = outside.create_publisher(
            topics.INITIAL_POSE.type, topics.INITIAL_POSE.name, topics.LOSSLESS
        )
        reset = outside.create_client(Trigger, f"/{topics.PMHT_MM}/reset")

        def look(_progress: Progress) -> None:
            for _ in range(20):
                executor.spin_once(timeout_sec=0.0)
            if len(heard) > 5 and not asked:
                asked.append(reset.call_async(Trigger.Request()))
                pose = topics.INITIAL_POSE.type()
                pose.header.frame_id = MAP
                pose.pose.pose.position.x = 5000.0
                pose.pose.covariance[[0, 7]] = 100.0
                placed.publish(pose)

        run_in_process(replace(plan, domain=domain), Interrupt(), look)
        assert asked[0].done() and asked[0].result().success
    place = [message.pose.pose.position.x for message in heard]
    assert np.diff(place).max() > 3000.0  # by the pose
