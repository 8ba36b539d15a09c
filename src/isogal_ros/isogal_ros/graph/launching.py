"""What the launch file does with its arguments: checks them before any node starts, and says which
node gets which parameters and whose end ends all.

No launch here: the launch file (`isogal_bringup`) turns this into its actions."""

import atexit
import math
import os
import re
import shlex
import shutil
import signal
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, ClassVar

from isogal.errors import InputError
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.checks import check_new_folder, checked
from isogal_ros.graph.domain import defaults
from isogal_ros.graph.parameter_files import (
    check_node,
    full_name,
    given_parameters,
    read_parameters,
    scenario_of,
    sections_of_nobody,
)
from isogal_ros.graph.plan import CLASSES, Plan, node_class
from isogal_ros.nodes.signals import INTERRUPTED
from isogal_ros.parameters.from_model import parameter_specs

DESCRIBED = {
    "params": ("", "parameter file (YAML) for all nodes"),
    "rate": ("1.0", "simulated seconds per second; 0.0 = as fast as the graph can"),
    "run": ("0", "index of the run: which random numbers of the seed"),
    "recorder": ("true", "whether everything is recorded"),
    "bag": ("", "folder of the recording; must not exist"),
    "respawn": ("false", "whether a node that dies is started again, from its checkpoint"),
    "checkpoint": ("", "folder of the checkpoints; empty = a new one, where nodes respawn"),
    "namespace": ("", "of all nodes and of the topics that are not absolute"),
    "vehicle": ("simulated", "simulated, or real: without the simulator, for real sensors"),
    "use_sim_time": (
        "auto",
        "whether the nodes' clocks go by /clock; auto: with a simulated vehicle. The simulator's"
        " own never does",
    ),
    "log_level": ("info", "debug, info, warn, error or fatal"),
    "set": ("", "keys of the scenario, which count before those of params: KEY=VALUE KEY=VALUE"),
}
"""Arguments of the launch file: default and description."""
LOG_LEVELS = ("debug", "info", "warn", "error", "fatal")
VEHICLES = ("simulated", "real")
_NAMESPACE = re.compile(r"/?([A-Za-z]\w*)(/[A-Za-z]\w*)*")
_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}


_ENDED_WHEN_ASKED = (0, INTERRUPTED, -signal.SIGINT, -signal.SIGTERM)
"""Exit codes of a node that was asked to end."""


class NodeFailedError(RuntimeError):
    """A node failed; raised where launch calls back, launch ends all in order and exits with 1, as
    it does for no other reason."""


@dataclass(frozen=True)
class Launched(Plan):
    """A run of the graph by a launch file, whose arguments can be used."""

    params: str = ""
    respawn: bool = False
    namespace: str = ""
    sim_time: bool = False
    log_level: str = "info"
    keys: Mapping[str, Any] = field(default_factory=dict)
    """Parameters of the scenario that were set one by one."""
    of_recorder: ClassVar[Mapping[str, Any]] = {}

    @property
    def ros_arguments(self) -> list[str]:
        """Arguments of every node."""
        return ["--log-level", self.log_level]

    @property
    def environment(self) -> dict[str, str]:
        """What the nodes' environment has where the user has not said otherwise."""
        return defaults(os.environ)

    def package(self, name: str) -> str:
        """Return the package of a node."""
        return "isogal_ros" if name == RECORDER else topics.kind_of(name)

    def executable(self, name: str) -> str:
        """Return the program of a node."""
        return topics.kind_of(name)

    def own(self, name: str) -> dict[str, Any]:
        """Return a node's own parameters, which count before those of the file."""
        sections = node_class(name).sections
        keys = {key: own for key, own in self.keys.items() if key.partition(".")[0] in sections}
        sim_time = {"use_sim_time": self.sim_time and name != topics.INS_SIM}
        return keys | super().own(name) | sim_time

    def ends_all(self, name: str, code: int, ending: bool = False) -> str | None:
        """Return why the end of a node with an exit code ends all; None = it does not, or all is
        `ending` already.

        Raises
        ------
        NodeFailedError
            It failed, so that the launch has to fail as well.
        """
        reason = f"{name} has ended with code {code}"
        if ending:
            if code in _ENDED_WHEN_ASKED:
                return None
            raise NodeFailedError(reason)
        if name == topics.INS_SIM and code == 0:
            return "the simulated vehicle has arrived"
        # one that says that it failed would fail again
        if self.respawn and (code <= 0 or code == INTERRUPTED):
            return None
        if code == 0:
            return reason
        raise NodeFailedError(reason)


def check(values: Mapping[str, str]) -> Launched:
    """Return the arguments as what they mean.

    Raises
    ------
    InputError
        One cannot be used; the line names it and says what is allowed.
    """
    rate = _number("rate", values["rate"], float)
    if not (math.isfinite(rate) and 0.0 <= rate <= 10000.0):
        raise InputError(f"rate: must be from 0.0 to 10000.0, not {values['rate']!r}")
    run = _number("run", values["run"], int)
    if run < 0:
        raise InputError(f"run: must be 0 or more, not {values['run']!r}")
    recorder, respawn = (_boolean(name, values[name]) for name in ("recorder", "respawn"))
    keys, namespace = _keys(values["set"]), _namespace(values["namespace"])
    real = _choice("vehicle", values["vehicle"], VEHICLES) == "real"
    clock, checkpoint = values["use_sim_time"], values["checkpoint"]
    sim_time = not real if clock == "auto" else _boolean("use_sim_time", clock)
    log_level = _choice("log_level", values["log_level"], LOG_LEVELS)
    if recorder:
        _check_bag(values["bag"])
    if checkpoint:
        check_new_folder("checkpoint", checkpoint)
    # last, as it takes longest
    scenario = _check_params(values["params"], keys, namespace, real, recorder)
    if respawn and not checkpoint:
        checkpoint = tempfile.mkdtemp(prefix="isogal-checkpoint-")
        atexit.register(shutil.rmtree, checkpoint, ignore_errors=True)
    return Launched(
        scenario,
        Path(values["bag"]) if recorder else None,
        run,
        rate,
        checkpoint=Path(checkpoint) if checkpoint else None,
        real=real,
        params=values["params"],
        respawn=respawn,
        namespace=namespace,
        sim_time=sim_time,
        log_level=log_level,
        keys=keys,
    )


def check_words(words: Sequence[str], file: str) -> None:
    """Raise InputError for an argument that a launch file does not have, which launch would take
    without a word.

    Parameters
    ----------
    words : sequence of str
        The command line; where it does not name the file, another file includes it, and the
        arguments are the other's.
    file : str
        The launch file's name.
    """
    names = [Path(word).name for word in words]
    for word in words[names.index(file) :] if file in names else ():
        name, assigned, _ = word.partition(":=")
        if assigned and name not in DESCRIBED:
            near = get_close_matches(name, DESCRIBED, 1, 0.5)
            hint = f"did you mean {near[0]!r}?" if near else f"allowed: {', '.join(DESCRIBED)}"
            raise InputError(f"{name}: no argument of {file}; {hint}")


def _choice(name: str, text: str, allowed: Sequence[str]) -> str:
    if text not in allowed:
        raise InputError(f"{name}: must be {', '.join(allowed)}, not {text!r}")
    return text


def _namespace(text: str) -> str:
    if text and not _NAMESPACE.fullmatch(text):
        raise InputError(f"namespace: must be words of letters, digits and _, not {text!r}")
    return text


def _keys(text: str) -> dict[str, Any]:
    """Return parameters from ``KEY=VALUE KEY=VALUE``, values in YAML."""
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise InputError(f"set: {error}: {text!r}") from None
    what = "key of the scenario that is a parameter"
    return given_parameters("set", "KEY=VALUE", words, parameter_specs(Scenario), what)


def _number(name: str, text: str, kind: Any) -> Any:
    try:
        return kind(text)
    except ValueError:
        raise InputError(f"{name}: must be a number, not {text!r}") from None


def _boolean(name: str, text: str) -> bool:
    value = _BOOLEANS.get(text.lower())
    if value is None:
        raise InputError(f"{name}: must be true or false, not {text!r}")
    return value


def _check_params(
    path: str, keys: Mapping[str, Any], namespace: str, real: bool, recorder: bool
) -> Scenario:
    """Return the scenario of a parameter file with some keys changed; raises InputError unless all
    nodes can use both."""
    where = f"params: {path}"
    document = read_parameters(path, where)
    of_all = {"/**": document.get("/**", {})}
    scenario = scenario_of(of_all, "", where)
    if keys:
        scenario = scenario_of(of_all, "", "set", keys)
    names = Plan(scenario, Path() if recorder else None, real=real).names
    told: list[Scenario] = []
    for name in names:
        full = full_name(namespace, name)
        check_node(document, name, full, where)
        own = scenario_of(document, full, f"{where}: {name}", keys)
        if own not in told:
            told.append(own)
    # which may be another node's of the user, thus no error
    for line in sections_of_nobody(document, {*names, *CLASSES}, namespace):
        print(f"isogal: {where}: {line}", file=sys.stderr, flush=True)
    for one in told:
        checked(one, simulated=not real)
    return scenario


def _check_bag(path: str) -> None:
    folder = Path(path)
    if not path or folder.exists():
        raise InputError(f"bag: {path!r}: there is something already; give a new folder")
    check_new_folder("bag", path)
