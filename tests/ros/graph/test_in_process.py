"""The graph in one process ends as it should, whatever fails."""

import errno

import pytest

from helpers.node_bench import run_by_middleware
from helpers.recordings import collect
from isogal.errors import InputError
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.writer import BagWriter
from isogal_ros.graph.plan import GraphError, Plan
from ukf_fusion_node.node import UkfFusionNode


def test_a_gravimeters_sigma_is_refused_for_another_field(magnetic) -> None:
    default = Scenario().gravimeter
    with pytest.raises(
        InputError, match=r"gravimeter\.sigma: must be in nT where field is magnetic"
    ):
        run_by_middleware(magnetic.model_copy(update={"gravimeter": default}), None)


def test_a_recorder_that_fails_fails_the_run(scenario, tmp_path, monkeypatch) -> None:
    write = BagWriter.write

    def full(self, *words) -> None:
        if self.messages == 300:
            raise OSError(errno.ENOSPC, "No space left on device")
        write(self, *words)

    monkeypatch.setattr(BagWriter, "write", full)
    with pytest.raises(GraphError, match=r"^isogal_recorder: .* No space left on device"):
        run_by_middleware(scenario(), tmp_path / "bag")
    assert len(collect(tmp_path / "bag").truth) > 10


def test_a_node_that_stops_answering(scenario, tmp_path, monkeypatch) -> None:
    publish, own = UkfFusionNode._publish, Plan.own
    monkeypatch.setattr(
        UkfFusionNode, "_publish", lambda self: publish(self) if self.samples < 20 else None
    )
    impatient = {"reply_timeout": 1.0}
    monkeypatch.setattr(
        Plan,
        "own",
        lambda plan, name: own(plan, name) | (impatient if name == topics.INS_SIM else {}),
    )
    with pytest.raises(
        GraphError, match=r"no answer to the step at 20\.000 s .* missing nav/odom \(0 of 1\)"
    ):
        run_by_middleware(scenario(), tmp_path / "bag")
