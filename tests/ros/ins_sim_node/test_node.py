"""The simulator's node by itself: whom it waits for, and its pace."""

import shutil

import pytest
from rclpy.parameter import Parameter

from helpers.node_bench import bench, stamps
from ins_sim_node import lock_step
from isogal_ros import topics
from isogal_ros.nodes.health import ERROR


def test_it_names_the_nodes_that_are_not_ready(scenario) -> None:
    with bench(topics.INS_SIM, scenario(), peers=list(topics.NODES), start_timeout=0.5) as made:
        made.wait(lambda: made.node.finished)
        assert made.node.exit_code == 1
        assert "cannot begin after 0.5 s" in made.node.failure
        assert "ukf_fusion_node is not ready" in made.node.failure
        made.wait(lambda: made.says() and made.says()[-1][0] == ERROR)


def test_it_says_what_it_waits_for_and_ends_where_no_answer_comes(scenario, monkeypatch) -> None:
    monkeypatch.setattr(lock_step, "SILENT", 0.1)
    with bench(topics.INS_SIM, scenario(), rate=0.0, reply_timeout=0.5) as made:
        missing = "missing nav/odom (0 of 1), the reduced reading of stamp 10.000 s"
        made.wait(lambda: made.told(f"waits for an answer: {missing}"))
        made.wait(lambda: made.node.finished)
        assert f"no answer to the step at 10.000 s within 0.5 s: {missing}" in made.node.failure
        assert made.node.exit_code == 1
        assert made.heard["ground_truth/fix"]


@pytest.fixture
def unlocked(scenario):
    """Makes a node without lock-step on a bench."""
    fast = {"rate": 200.0, "lock_step": False}
    return lambda **own: bench(topics.INS_SIM, scenario("route.duration=20.0"), **fast | own)


def begun(scenario, **own) -> list[float]:
    """The stamps of what is published before any answer."""
    with bench(topics.INS_SIM, scenario, rate=0.0, reply_timeout=0.2, **own) as made:
        made.wait(lambda: made.node.finished)
        return stamps(made, topics.IMU)


def test_it_publishes_the_steps_until_a_reading_at_once(scenario) -> None:
    assert begun(scenario("gravimeter.interval=4.0")) == list(range(1, 5))
    assert begun(scenario("imu.rate=4.0", "fusion.rate=1.0")) == [0] * 3 + [1] * 4 + [2]
    # one step where others could change what is done with it
    assert begun(scenario("height.source=barometer")) == [1]
    assert begun(scenario("gnss.available=[[0, 60]]")) == [1]


def test_a_simulator_that_may_be_killed_publishes_one_step(scenario, tmp_path) -> None:
    assert begun(scenario(), checkpoint=str(tmp_path / "c")) == [1]


def test_without_lock_step_it_keeps_its_rate_which_may_change(unlocked, tmp_path) -> None:
    """Arrived it leaves no checkpoint even where it stays."""
    own = {"checkpoint": str(tmp_path), "exit_at_end": False, "rate": 0.01}
    with unlocked(**own) as made:
        made.wait(lambda: made.node.step == 0)
        assert made.node.set_parameters([Parameter("rate", value=500.0)])[0].successful
        # the bench lets all timers come, however long they wait
        assert 2_000_000 in {timer.timer_period_ns for timer in made.node.timers}
        made.wait(lambda: made.node.health.message == "finished")
        assert stamps(made, topics.IMU) == list(range(1, 21))
        assert stamps(made, topics.TRUTH_FIX) == list(range(21))
        assert len(made.heard["/clock"]) == 21
        made.node.close()
        assert not list(tmp_path.iterdir())


def test_killed_after_the_last_step_it_does_not_begin_again(unlocked, tmp_path) -> None:
    folder = tmp_path / "checkpoint"
    with unlocked(checkpoint=str(folder)) as made:
        made.wait(lambda: made.node.finished)
        shutil.copytree(folder, tmp_path / "as it was")
    with unlocked(checkpoint=str(tmp_path / "as it was")) as made:
        made.wait(lambda: made.node.finished)
        assert made.node.exit_code == 0
        assert not made.heard["/clock"]
