"""A node as a process of its own."""

import importlib
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from std_msgs.msg import Float64

from helpers.commands import PATIENCE
from helpers.own_memory import left_of
from isogal_ros import topics
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.spin import run_node


class Finished(GraphNode):
    """A node with nothing to do."""

    def setup(self) -> None:
        self.finished = True
        SEEN.append((self.get_name(), self.settings.run))


SEEN: list[tuple[str, int]] = []


def test_arguments_reach_the_node() -> None:
    SEEN.clear()
    args = ["--ros-args", "-r", "__node:=other", "-p", "run:=3"]
    assert run_node("quiet", lambda: Finished("quiet"), args) == 0
    assert SEEN == [("other", 3)]


class Endless(GraphNode):
    """A node that hears itself: a message always waits."""

    def setup(self) -> None:
        self.heard = 0
        self.level = self.advertise(topics.PROTECTION_LEVEL)
        self.hear(topics.PROTECTION_LEVEL, self.take)
        self.create_timer(0.01, lambda: self.heard or self.level.publish(Float64()))

    def take(self, message: Float64) -> None:
        self.heard += 1
        if self.heard == 100:
            self.end()
        assert self.heard < 5000
        self.level.publish(message)

    def end(self) -> None:
        self.finished = True


class Signalled(Endless):
    """One that a signal ends."""

    def end(self) -> None:
        signal.raise_signal(signal.SIGTERM)


@pytest.mark.parametrize("kind", [Endless, Signalled])
def test_a_node_ends_at_once_whatever_waits(kind) -> None:
    made = []

    def make() -> Endless:
        made.append(kind("endless"))
        return made[0]

    assert run_node("endless", make, []) == 0
    assert made[0].heard == 100


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--ros-args", "-p", "runn:=3"], "unknown parameter 'runn'; did you mean 'run'?"),
        (["-p", "run:=3"], "unknown argument '-p'; parameters are --ros-args -p KEY:=VALUE"),
        (["--ros-args", "-r"], "Couldn't parse trailing -r flag. No remap rule found.\n"),
    ],
)
def test_a_bad_argument_is_one_line_and_exit_2(capsys, args, message) -> None:
    assert run_node("quiet", lambda: Finished("quiet"), args) == 2
    err = capsys.readouterr().err
    assert err.startswith("quiet: ") and message in err and err.count("\n") == 1


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("ins_sim_node.node", topics.INS_SIM),
        ("gravimeter_node.node", topics.GRAVIMETER),
        ("pmht_mm_node.node", topics.PMHT_MM),
        ("ukf_fusion_node.node", topics.UKF_FUSION),
        ("isogal_ros.bags.recorder", "isogal_recorder"),
    ],
)
def test_every_entry_point_passes_its_arguments_on(module, name, capsys) -> None:
    main = importlib.import_module(module).main
    with pytest.raises(SystemExit) as end:
        main(["--ros-args", "-p", "no_such_parameter:=1"])
    assert end.value.code == 2
    assert capsys.readouterr().err.startswith(f"{name}: unknown parameter 'no_such_parameter'")


def test_a_process_ends_whatever_hangs_after_its_node() -> None:
    """The middleware sometimes waits for ever when it is taken down. No shared memory is left."""
    lines = (
        "import atexit, os, time",
        "from helpers.own_memory import own_memory",
        "from ros.nodes.test_spin import Finished",
        "from isogal_ros.nodes.spin import main_of",
        "class Told(Finished):",
        "    def setup(self):",
        "        super().setup()",
        "        print(*own_memory(os.getpid()))",
        "atexit.register(lambda: print('taken down', flush=True) or time.sleep(1000.0))",
        "main_of(Told, 'quiet')(['--ros-args'])",
    )
    ended = subprocess.run(
        [sys.executable, "-c", "\n".join(lines)],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    own = {Path(word) for word in ended.stdout.split()}
    assert own and all(path.is_absolute() for path in own)
    assert not left_of(own)
