"""Stand-ins for launch and launch_ros, which the wheels do not have: they follow launch 3.4 in
what the launch file uses (arguments, on_exit, respawn, SIGINT, SIGTERM 5 s later, SIGKILL 5 s
later)."""

import importlib.util
import os
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import yaml

from helpers.commands import PATIENCE
from isogal_ros.graph.forkserver import start_node
from isogal_ros.graph.plan import CLASSES

LAUNCH_WAITS = 5.0
"""s after each of these signals."""
BRINGUP = Path(__file__).resolve().parents[2] / "src" / "isogal_bringup"


class Action:
    """Keeps what it was called with."""

    def __init__(self, *arguments: Any, **keys: Any) -> None:
        self.arguments, self.keys = arguments, keys


class Argument(Action):
    """A DeclareLaunchArgument."""


class Share(Action):
    """FindPackageShare."""

    def perform(self, _context: Any) -> str:
        """Return the sources' folder."""
        assert self.arguments == ("isogal_bringup",)
        return str(BRINGUP)


class Joined(Action):
    """PathJoinSubstitution."""

    def perform(self, context: Any) -> str:
        """Join them."""
        words = (w if isinstance(w, str) else w.perform(context) for w in self.arguments[0])
        return str(Path(*words))


class Configuration(Action):
    """LaunchConfiguration."""

    def perform(self, context: Any) -> str:
        """Return the argument's value."""
        return context.values[self.arguments[0]]


MODULES = {
    "launch": {"LaunchDescription": Action},
    "launch.actions": {
        "DeclareLaunchArgument": Argument,
        "OpaqueFunction": Action,
        "Shutdown": Action,
    },
    "launch.substitutions": {
        "LaunchConfiguration": Configuration,
        "PathJoinSubstitution": Joined,
    },
    "launch_ros": {},
    "launch_ros.actions": {"Node": Action},
    "launch_ros.substitutions": {"FindPackageShare": Share},
}


@dataclass
class Launch:
    """One launch of a file with arguments."""

    file: Path
    arguments: dict[str, str]
    folder: Path
    """For the nodes' output."""
    patch: Any
    """Puts the stand-ins where the file imports them from."""
    declared: dict[str, tuple[Any, str]] = field(default_factory=dict)
    """Default and description of each argument."""
    nodes: dict[str, dict[str, Any]] = field(default_factory=dict)
    running: dict[str, BaseProcess] = field(default_factory=dict)
    died: list[tuple[str, int]] = field(default_factory=list)
    """Nodes that ended before the launch did, with their exit codes."""
    reason: str | None = None
    exit_code: int = 0
    """Launch's own."""

    def describe(self) -> None:
        """Do what launch does before it starts processes."""
        for name, classes in MODULES.items():
            module = ModuleType(name)
            for attribute, made in classes.items():
                setattr(module, attribute, made)
            self.patch.setitem(sys.modules, name, module)
        spec = importlib.util.spec_from_file_location("launched", self.file)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        entities = module.generate_launch_description().arguments[0]
        context = SimpleNamespace(values={})
        for entity in entities:
            if isinstance(entity, Argument):
                self._declare(entity, context)
            else:
                for node in entity.keys["function"](context):
                    self.nodes[node.keys["name"]] = node.keys
        assert set(self.arguments) <= set(self.declared)

    def _declare(self, entity: Argument, context: Any) -> None:
        (name,), default = entity.arguments, entity.keys["default_value"]
        self.declared[name] = default, entity.keys["description"]
        value = default if isinstance(default, str) else default.perform(context)
        context.values[name] = self.arguments.get(name, value)

    def run(self, when: str, kill: Sequence[str]) -> None:
        """Run to the end, once described; kill nodes one after the other once the log says a
        word, each when all that were killed are back."""
        starts, waiting, pause = dict.fromkeys(self.nodes, 0.0), list(kill), 0.0
        end = time.monotonic() + PATIENCE
        while self.reason is None:
            now = time.monotonic()
            assert now < end, self.output()
            for name in [name for name, due in starts.items() if now >= due]:
                del starts[name]
                self._start(name)
            time.sleep(0.05)
            if waiting and not starts and now > pause and when in self.output() and self._up():
                self.running[waiting.pop(0)].kill()
                pause = now + 2.5
            for name, process in self.running.items():
                if name not in starts and process.exitcode is not None:
                    self.died.append((name, process.exitcode))
                    self.reason = self.reason or self.reason_of(name, process.exitcode)
                    starts[name] = now + self.nodes[name]["respawn_delay"]
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            self._send(number)
        for name, process in self.running.items():
            self.reason_of(name, process.exitcode, ending=True)

    def _up(self) -> bool:
        """Whether all nodes can be asked to end."""
        return all(catches(process.pid, signal.SIGTERM) for process in self.running.values())

    def _send(self, number: int) -> None:
        """Send a signal to the nodes that are there, and wait until they end, or a while."""
        for process in self.running.values():
            if process.exitcode is None:
                os.kill(process.pid, number)
        for process in self.running.values():
            process.join(LAUNCH_WAITS)

    def reason_of(self, name: str, code: int, ending: bool = False) -> str | None:
        """Why the end of a node with an exit code ends all; None = it does not."""
        context = SimpleNamespace(is_shutdown=ending)
        try:
            shutdown = self.nodes[name]["on_exit"](SimpleNamespace(returncode=code), context)
        except Exception as error:  # which launch takes as a reason to end
            self.exit_code = 1
            return str(error)
        return None if shutdown is None else shutdown.keys["reason"]

    def _start(self, name: str) -> None:
        keys = self.nodes[name]
        file, own = keys["parameters"]
        own_file = self.folder / f"{name}.yaml"
        own_file.write_text(yaml.safe_dump({"/**": {"ros__parameters": own}}))
        words = ["--ros-args", "-r", f"__node:={name}", "-r", f"__ns:=/{keys['namespace']}"]
        words += ["--params-file", file, "--params-file", str(own_file), *keys["ros_arguments"]]
        environment = os.environ | keys["additional_env"]
        log = self.folder / f"{name}.log"
        self.running[name] = start_node(name, CLASSES[name][0], words, environment, log)

    def output(self) -> str:
        """What all nodes have said."""
        logs = (self.folder / f"{name}.log" for name in self.nodes)
        return "".join(log.read_text() for log in logs if log.exists())

    def kill(self) -> None:
        """End what is left."""
        self._send(signal.SIGKILL)


def catches(pid: int, number: int) -> bool:
    """Whether a process has a handler for a signal: a node's first lines have run."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return False
    masks = [line.split()[1] for line in lines if line.startswith("SigCgt:")]
    return bool(masks) and bool(int(masks[0], 16) >> (number - 1) & 1)
