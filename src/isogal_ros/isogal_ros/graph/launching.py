"""What the launch file does with its arguments: checks them before any node starts, and says which
node gets which parameters and whose end ends all.

No launch here: the launch file (`isogal_bringup`) turns this into its actions."""

import atexit
import math
import os
import re
import shlex
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from isogal.errors import InputError
from isogal.scenario import Scenario
from isogal.yaml_text import parse_yaml
from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.domain import defaults
from isogal_ros.graph.plan import Plan, node_class, nodes_of
from isogal_ros.parameters.from_model import parameter_specs
from isogal_ros.parameters.values import scenario_from

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


@dataclass(frozen=True)
class Launched:
    """Arguments that can be used."""

    params: str
    rate: float
    run: int
    bag: str | None
    """None = nothing is recorded."""
    respawn: bool
    checkpoint: str
    """Empty = none."""
    scenario: Scenario = field(default_factory=Scenario)
    """What the parameter file says of all nodes."""
    namespace: str = ""
    real: bool = False
    """Whether the sensors are those of a vehicle, and nothing is simulated."""
    sim_time: bool = False
    log_level: str = "info"
    keys: Mapping[str, Any] = field(default_factory=dict)
    """Parameters of the scenario that were set one by one."""

    @property
    def names(self) -> tuple[str, ...]:
        """The nodes, the recorder first, so that it hears everything."""
        nodes = tuple(
            name for name in nodes_of(self.scenario) if not (self.real and name == topics.INS_SIM)
        )
        return nodes if self.bag is None else (RECORDER, *nodes)

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
        """Return a node's own parameters."""
        values: dict[str, Any] = {"run": self.run, "checkpoint": self.checkpoint}
        values |= {key: value for key, value in self.keys.items() if _declares(name, key)}
        values |= {"use_sim_time": self.sim_time and name != topics.INS_SIM}
        if name == RECORDER:
            return values | {"bag": self.bag, "resume": self.respawn}
        if name == topics.INS_SIM:
            values |= {"rate": self.rate}
        # how many recorders each node waits for before it calls itself ready
        values |= {"recorders": int(self.bag is not None)}
        values |= Plan(self.scenario, None).of_fields(name)
        if self.real:
            values |= {"peers": [other for other in self.names if other != RECORDER]}
            if topics.kind_of(name) == topics.GRAVIMETER:
                values |= {"simulate": False}
        return values

    def ends_all(self, name: str, code: int | None) -> str | None:
        """Return why the end of a node with an exit code ends all; None = it does not."""
        if name == topics.INS_SIM and code == 0:
            return "the simulated vehicle has arrived"
        if self.respawn and code != 2:  # which means that its parameters cannot be used
            return None
        return f"{name} has ended with code {code}"


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
    keys = _keys(values["set"])
    scenario = _checked_params(values["params"], keys)
    if recorder:
        _check_bag(values["bag"])
    checkpoint = values["checkpoint"]
    if respawn and not checkpoint:
        checkpoint = tempfile.mkdtemp(prefix="isogal-checkpoint-")
        atexit.register(shutil.rmtree, checkpoint, ignore_errors=True)
    bag = values["bag"] if recorder else None
    real = _choice("vehicle", values["vehicle"], VEHICLES) == "real"
    clock = values["use_sim_time"]
    return Launched(
        values["params"],
        rate,
        run,
        bag,
        respawn,
        checkpoint,
        scenario,
        namespace=_namespace(values["namespace"]),
        real=real,
        sim_time=not real if clock == "auto" else _boolean("use_sim_time", clock),
        log_level=_choice("log_level", values["log_level"], LOG_LEVELS),
        keys=keys,
    )


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
    specs, found = {spec.name: spec for spec in parameter_specs(Scenario)}, {}
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise InputError(f"set: {error}: {text!r}") from None
    for word in words:
        key, equals, value = word.partition("=")
        if not equals:
            raise InputError(f"set: must be KEY=VALUE, not {word!r}")
        if key not in specs:
            near = get_close_matches(key, specs, 1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise InputError(f"set: {key}: no key of the scenario that is a parameter{hint}")
        found[key] = specs[key].cast(parse_yaml(value, f"set: {key}"))
    return found


def _declares(name: str, key: str) -> bool:
    """Whether a node has a parameter of the scenario."""
    return key.partition(".")[0] in node_class(name).sections


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


def _checked_params(path: str, keys: Mapping[str, Any]) -> Scenario:
    """Return the scenario of a parameter file with some keys changed; raises InputError unless it
    can be used."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"params: {path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"params: {path}: is not a text in UTF-8 ({error.reason})") from None
    document = parse_yaml(text, f"params: {path}")
    if not isinstance(document, dict) or not all(
        isinstance(entry, dict) and isinstance(entry.get("ros__parameters"), dict)
        for entry in document.values()
    ):
        raise InputError(f"params: {path}: must map names of nodes, or /**, to ros__parameters")
    of_all = document.get("/**", {}).get("ros__parameters", {})
    known = {spec.name.split(".")[0] for spec in parameter_specs(Scenario)}
    sections = {key: value for key, value in of_all.items() if key in known}
    scenario = scenario_from(_flat(sections), f"params: {path}")
    if keys:
        specs = {spec.name: spec for spec in parameter_specs(Scenario)}
        changed = {key: specs[key].to_field(value) for key, value in keys.items()}
        scenario = scenario_from(_flat(sections) | changed, "set")
    nodes_of(scenario)
    return scenario


def _flat(document: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    specs = {spec.name: spec for spec in parameter_specs(Scenario)}
    values: dict[str, Any] = {}
    for key, value in document.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            values |= {name: value} if name in specs else _flat(value, f"{name}.")
        else:
            spec = specs.get(name)
            values[name] = value if spec is None else spec.to_field(spec.cast(value))
    return values


def _check_bag(path: str) -> None:
    folder = Path(path)
    if not path or folder.exists():
        raise InputError(f"bag: {path!r}: there is something already; give a new folder")
    parent = folder.absolute().parent
    while not parent.exists():
        parent = parent.parent
    if not os.access(parent, os.W_OK):
        raise InputError(f"bag: {path}: {parent} cannot be written")
