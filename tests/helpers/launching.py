"""Stand-ins for launch and launch_ros, which the wheels do not have: they follow launch 3.4 in
what the launch file uses (arguments, on_exit, respawn, SIGINT, SIGTERM 5 s later, SIGKILL 5 s
later)."""

import importlib.util
import os
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import yaml

from helpers.commands import PATIENCE
from helpers.processes import Forked, end_as_launch_does, is_up, ros_arguments

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
    environment: dict[str, str] = field(default_factory=dict)
    """Of the nodes, beside this process's own."""
    declared: dict[str, tuple[Any, str]] = field(default_factory=dict)
    """Default and description of each argument."""
    nodes: dict[str, dict[str, Any]] = field(default_factory=dict)
    running: dict[str, Any] = field(default_factory=dict)
    codes: dict[str, int] = field(default_factory=dict)
    respawned: dict[str, int] = field(default_factory=dict)
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

    def start(self) -> None:
        """Start the nodes and wait until each can be asked to end."""
        for name in self.nodes:
            self._start(name)
        end = time.monotonic() + PATIENCE
        while not self._settled():
            assert time.monotonic() < end, self.output()
            time.sleep(0.05)

    def end(self) -> dict[str, int]:
        """End the nodes as Ctrl-C does; return their exit codes."""
        names = list(self.running)
        codes = end_as_launch_does([self.running[name] for name in names])
        return dict(zip(names, codes, strict=True))

    def run(self, when: str = "", kill: list[str] | None = None) -> None:
        """Run to the end, once described; kill nodes one after the other once the log says a
        word."""
        for name in self.nodes:
            self._start(name)
        self.run_on(when, kill)

    def run_on(self, when: str = "", kill: list[str] | None = None) -> None:
        """Do so with nodes that have been started."""
        kill, again, end = list(kill or ()), {}, time.monotonic() + PATIENCE
        due = 0.0
        while self.reason is None:
            assert time.monotonic() < end, self.output()
            time.sleep(0.05)
            if kill and when in self.output() and self._settled() and time.monotonic() > due:
                self.running[kill.pop(0)].kill()
                due = time.monotonic() + 2.5
            self._look(again)
        died = {name for name, _ in self.died}
        self.codes |= self.end()
        for name, code in self.codes.items():
            if name not in died or name in self.respawned:
                self.reason_of(name, code, ending=True)

    def _settled(self) -> bool:
        return all(process.poll() is None and is_up(process) for process in self.running.values())

    def _look(self, again: dict[str, float]) -> None:
        """Deal with processes that have ended."""
        for name, process in self.running.items():
            code = process.poll()
            if code is None:
                continue
            if name not in again:
                self.died.append((name, code))
                self.reason = self.reason or self.reason_of(name, code)
                again[name] = time.monotonic() + self.nodes[name]["respawn_delay"]
            if (
                self.reason is None
                and self.nodes[name]["respawn"]
                and time.monotonic() > again[name]
            ):
                del again[name]
                self.respawned[name] = self.respawned.get(name, 0) + 1
                self._start(name)

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
        words = ros_arguments(name, files=(file, str(own_file)))
        words += ["-r", f"__ns:=/{keys['namespace']}", *keys["ros_arguments"]]
        environment = os.environ | keys["additional_env"] | self.environment
        self.running[name] = Forked(name, words, environment, self.folder / f"{name}.log")

    def output(self) -> str:
        """What all nodes have said."""
        logs = (self.folder / f"{name}.log" for name in self.nodes)
        return "".join(log.read_text() for log in logs if log.exists())

    def kill(self) -> None:
        """End what is left."""
        for process in self.running.values():
            process.kill()
            process.wait()
