"""What the launch file does with its arguments: checks them before any node starts, and says which
node gets which parameters and whose end ends all.

No launch here: the launch file (`isogal_bringup`) turns this into its actions."""

import atexit
import re
import shlex
import shutil
import signal
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, JsonValue, field_validator

from isogal.errors import InputError
from isogal.files import check_output
from isogal.scenario import Scenario, validated
from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.bags.remapping import Remapping
from isogal_ros.graph.parameter_files import ParameterFile, given_parameters
from isogal_ros.graph.plan import CLASSES, Plan, checked, node_class
from isogal_ros.nodes.signals import INTERRUPTED
from isogal_ros.parameters.from_model import parameter_specs

_NAMESPACE = re.compile(r"/?([A-Za-z]\w*)(/[A-Za-z]\w*)*")
_ENDED_WHEN_ASKED = (0, INTERRUPTED, -signal.SIGINT, -signal.SIGTERM)
"""Exit codes of a node that was asked to end."""


Words = Annotated[Sequence[str], BeforeValidator(shlex.split)]
"""Words of an argument, as a shell has them."""


class Arguments(BaseModel):
    """Arguments of the launch file, which are texts."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    params: str = Field("", description="parameter file (YAML) for all nodes")
    rate: float = Field(
        1.0,
        ge=0.0,
        le=10000.0,
        allow_inf_nan=False,
        description="simulated seconds per second; 0.0 = as fast as the graph can",
    )
    run: int = Field(0, ge=0, description="index of the run: which random numbers of the seed")
    recorder: bool = Field(True, description="whether everything is recorded")
    bag: str = Field("", description="folder of the recording; must not exist")
    respawn: bool = Field(
        False, description="whether a node that dies is started again, from its checkpoint"
    )
    checkpoint: str = Field(
        "", description="folder of the checkpoints; empty = a new one, where nodes respawn"
    )
    namespace: str = Field("", description="of all nodes and of the topics that are not absolute")
    vehicle: Literal["simulated", "real"] = Field(
        "simulated", description="simulated, or real: without the simulator, for real sensors"
    )
    use_sim_time: Annotated[Literal["auto", "true", "false"], BeforeValidator(str.lower)] = Field(
        "auto",
        description="whether the nodes' clocks go by /clock; auto: with a simulated vehicle. The"
        " simulator's own never does",
    )
    log_level: Literal["debug", "info", "warn", "error", "fatal"] = Field(
        "info", description="debug, info, warn, error or fatal"
    )
    remap: Words = Field(
        "",
        validate_default=True,
        description="topics of drivers in place of the graph's, as in /sbg/imu:=imu/data_raw"
        " /mgs6/g:=gravimeter/data_raw",
    )
    set: Words = Field(
        "",
        validate_default=True,
        description="keys of the scenario, which count before those of params: KEY=VALUE"
        " KEY=VALUE",
    )

    @field_validator("namespace")
    @classmethod
    def _is_namespace(cls, text: str) -> str:
        if text and not _NAMESPACE.fullmatch(text):
            raise ValueError(f"must be words of letters, digits and _, not {text!r}")
        return text

    @property
    def remappings(self) -> list[tuple[str, str]]:
        """Names of the graph, and those of drivers in their place."""
        names = Remapping.parse(self.remap, "remap").names
        return [(own.lstrip("/"), given) for given, own in names.items()]

    @property
    def keys(self) -> dict[str, JsonValue]:
        """Parameters of the scenario that are set one by one, values in YAML."""
        return given_parameters("set", self.set, parameter_specs(Scenario))

    @property
    def sim_time(self) -> bool:
        """Whether the clocks of nodes other than the simulator go by /clock."""
        auto = "true" if self.vehicle == "simulated" else "false"
        return self.use_sim_time.replace("auto", auto) == "true"


DESCRIBED = {
    # as launch's users write them
    name: (str(item.default).lower(), item.description or "")
    for name, item in Arguments.model_fields.items()
}
"""Arguments of the launch file: default and description."""


class NodeFailedError(RuntimeError):
    """A node failed; raised where launch calls back, launch ends all in order and exits with 1, as
    it does for no other reason."""


@dataclass(frozen=True)
class Launched(Plan):
    """A run of the graph by a launch file, whose arguments can be used."""

    arguments: Arguments = field(default_factory=Arguments)

    def package(self, name: str) -> str:
        """Return the package of a node."""
        return "isogal_ros" if name == RECORDER else topics.kind_of(name)

    def own(self, name: str) -> dict[str, JsonValue]:
        """Return a node's own parameters, which count before those of the file."""
        keys = {
            key: value
            for key, value in self.arguments.keys.items()
            if key.partition(".")[0] in node_class(name).sections
        }
        sim_time = self.arguments.sim_time and name != topics.INS_SIM
        return keys | super().own(name) | {"use_sim_time": sim_time}

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
        if self.arguments.respawn and (code <= 0 or code == INTERRUPTED):
            return None
        if code == 0:
            return reason
        raise NodeFailedError(reason)


def check(values: Mapping[str, str], words: Sequence[str], file: str) -> Launched:
    """Return the arguments as what they mean.

    Parameters
    ----------
    values : mapping
        Texts by name.
    words : sequence of str
        The command line, which may name arguments that there are not: launch takes them without a
        word. Where it does not name the launch file, another file includes it, and the arguments
        are the other's.
    file : str
        The launch file's name.

    Raises
    ------
    InputError
        One cannot be used; the line names it and says what is allowed.
    """
    names = [Path(word).name for word in words]
    own = words[names.index(file) :] if file in names else ()
    assigned = (word.partition(":=") for word in own)
    others = {name: "" for name, equals, _ in assigned if equals and name not in values}
    arguments = validated(Arguments, {**values, **others}, where=f"{file}: ")
    keys, _ = arguments.keys, arguments.remappings
    if arguments.recorder:
        if not arguments.bag or Path(arguments.bag).exists():
            raise InputError(f"bag: must name a new folder, not {arguments.bag!r}")
        check_output(arguments.bag, folder=True, where="bag: ")
    if arguments.checkpoint:
        check_output(arguments.checkpoint, folder=True, where="checkpoint: ")
    # last, as it takes longest
    scenario = _check_params(arguments, keys)
    checkpoint = arguments.checkpoint
    if arguments.respawn and not checkpoint:
        checkpoint = tempfile.mkdtemp(prefix="isogal-checkpoint-")
        atexit.register(shutil.rmtree, checkpoint, ignore_errors=True)
    return Launched(
        scenario,
        Path(arguments.bag) if arguments.recorder else None,
        arguments.run,
        arguments.rate,
        checkpoint=Path(checkpoint) if checkpoint else None,
        real=arguments.vehicle == "real",
        of_recorder={},
        arguments=arguments,
    )


def _check_params(arguments: Arguments, keys: Mapping[str, JsonValue]) -> Scenario:
    """Return the scenario of the parameter file with some keys changed; raises InputError unless
    all nodes can use both."""
    where, real = f"params: {arguments.params}", arguments.vehicle == "real"
    file = ParameterFile.read(arguments.params, where)
    scenario = file.of_all.scenario("")
    if keys:
        scenario = replace(file.of_all, where="set").scenario("", keys)
    scenarios: list[Scenario] = []
    names = Plan(scenario, Path() if arguments.recorder else None, real=real).names
    space = f"/{arguments.namespace.strip('/')}/".replace("//", "/")
    for name in names:
        of_node = replace(file, where=f"{where}: {name}")
        of_node.check_node(name, space + name)
        own = of_node.scenario(space + name, keys)
        if own not in scenarios:
            scenarios.append(own)
    # which may be another node's of the user, thus no error
    for line in file.unmatched([space + name for name in {*names, *CLASSES}]):
        print(f"isogal: {where}: {line}", file=sys.stderr, flush=True)
    for one in scenarios:
        checked(one, simulated=not real)
    return scenario
