"""The base of every node of the graph: parameters, guarded subscriptions, diagnostics, readiness.

One that starts by itself (the parameter `autostart`, the default) is active once it is made."""

import time
from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field, JsonValue
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from std_srvs.srv import Trigger

from isogal.scenario import Scenario, truth_of
from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.drivers import Driver, Entrance
from isogal_ros.messages.frames import BASE, MAP, ODOM, FrameNames
from isogal_ros.messages.mounting import mounted, placed
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.health import ERROR, OK, STARTING, WARN, Health
from isogal_ros.nodes.heartbeat import Heartbeat
from isogal_ros.nodes.listening import Listening, Take
from isogal_ros.nodes.managed import ManagedNode
from isogal_ros.nodes.publishing import Publishing
from isogal_ros.nodes.static_transforms import static_transforms
from isogal_ros.parameters.declaration import declare, on_change
from isogal_ros.parameters.from_model import ParameterSpec, parameter_specs
from isogal_ros.parameters.values import Values, scenario_from, settings_from
from isogal_ros.topics import Topic

KEYS = frozenset(spec.name for spec in parameter_specs(Scenario))
"""Of a scenario, which a file that all nodes share may say to each."""
_UNKNOWN = "NODE_NAME_UNKNOWN"
"""In the name of a node of which the middleware knows the publisher first."""


class NodeSettings(BaseModel):
    """Parameters that every node of the graph has besides its sections of the scenario."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    autostart: bool = Field(
        True, description="activate the node when it is made; false: by its lifecycle services"
    )
    run: int = Field(0, ge=0, description="index of the run: which random numbers of the seed")
    recorders: int = Field(
        0, ge=0, le=100, description="recorders that must listen before the node is ready"
    )
    peers: tuple[str, ...] = Field(
        topics.NODES, description="nodes of the graph that must listen before the node is ready"
    )
    closing_time: float = Field(
        2.0,
        gt=0.0,
        le=60.0,
        description="s of wall time in which the node ends when it is asked to",
    )
    checkpoint: str = Field(
        "",
        description=(
            "folder of checkpoints, from which a node that is started again goes on; empty = none"
        ),
    )
    checkpoint_age: float = Field(
        3600.0, gt=0.0, description="how much older than the data a checkpoint may be, s"
    )
    diagnostics_period: float = Field(1.0, gt=0.0, description="wall time between diagnostics, s")
    drivers: dict[str, Driver] = Field(
        default_factory=dict,
        description=(
            "how messages of sensors come, by topic, where that is not as the graph has them:"
            " {TOPIC: {frame: of its messages, rotation: [roll, pitch, yaw] deg, translation:"
            " [x, y, z] m, from_tf: whether these are those of /tf_static, unit: mGal}}"
        ),
    )
    tf_timeout: float = Field(
        10.0, gt=0.0, description="how long transforms that `drivers` asks for are waited for, s"
    )
    map_frame: str = Field(MAP, min_length=1, description="what the frame map is called outside")
    odom_frame: str = Field(ODOM, min_length=1, description="what the frame odom is called")
    base_frame: str = Field(BASE, min_length=1, description="what the frame base_link is called")
    tf_prefix: str = Field(
        "", description="put before the names of all frames, with a slash between"
    )

    @property
    def frame_names(self) -> FrameNames:
        """What frames are called outside."""
        prefix = self.tf_prefix.strip("/")
        return FrameNames(self.map_frame, self.odom_frame, self.base_frame, prefix)


class GraphNode(ManagedNode):
    """A node with the parameters of some sections of the scenario and its own.

    Parameters
    ----------
    name, values, context : optional but for the name
        As of `ManagedNode`.

    Raises
    ------
    InputError
        A parameter is unknown or bad.
    """

    sections: ClassVar[Collection[str]] = ()
    """Sections of the scenario that the node declares."""
    settings_model: ClassVar[type[NodeSettings]] = NodeSettings
    mutable: ClassVar[Collection[str]] = ()
    """Parameters that may change at run time."""

    settings: Any
    """Own parameters, a `settings_model`, as each class says."""
    scenario: Scenario

    def __init__(
        self,
        name: str,
        values: Mapping[str, JsonValue] | None = None,
        context: Context | None = None,
    ) -> None:
        super().__init__(name, values, context)
        clock = getattr(context, "monotonic", None)  # of nodes that are alone on a bus
        self.monotonic: Callable[[], float] = clock or time.monotonic
        self.exit_code = 0
        self.failure = ""
        """Why the node failed, where it did."""
        self._publishing: list[Publishing] = []
        """The first is of the diagnostics."""
        self._listening: dict[str, Listening] = {}
        self._looks: list[Callable[[], None]] = []
        self.ready = False
        """Whether every publisher has had the listeners that the graph needs."""
        try:
            specs = self.specs()
            self.settings, self.scenario = self.read(name, declare(self, specs, KEYS))
            self.frame_names = self.settings.frame_names
            self._mount()
            self.health = Health(
                self.get_fully_qualified_name().lstrip("/"),
                self.advertise(topics.DIAGNOSTICS),
                from_seconds(self.settings.diagnostics_period),
                self.log,
                # where there is no wall time, that of the data
                None if clock else time.monotonic,
            )
            on_change(self, specs, lambda new: self.changed(new) if self.configured else None)
            steady, self._heartbeat = Clock(clock_type=ClockType.STEADY_TIME), Heartbeat(self)
            # made before `setup` makes anything, so that they outlive a cleanup
            self.create_timer(1.0, self._beat, clock=steady)
            self._readiness = self.create_timer(0.02, self._check_ready, clock=steady)
            if self.settings.autostart:
                self.start()
        except BaseException:
            self.destroy_node()
            raise

    def _mount(self) -> None:
        """Note how messages of sensors come, and where the sensors are."""
        entrance = Entrance(self.settings.drivers, self.frame_names)
        look = partial(static_transforms, self.context, self.settings.tf_timeout)
        self._entrance = placed(entrance, look)
        self.scenario = mounted(self.scenario, self._entrance.drivers)

    @classmethod
    def specs(cls) -> list[ParameterSpec]:
        """Return the parameters: own ones, and those of the sections of the scenario."""
        own = parameter_specs(cls.settings_model, mutable=cls.mutable)
        return own + parameter_specs(Scenario, sections=cls.sections, mutable=cls.mutable)

    @classmethod
    def read(cls, name: str, values: Values) -> tuple[NodeSettings, Scenario]:
        """Return settings and scenario of the values of all parameters; raises InputError, which
        begins with a name."""
        fields = cls.settings_model.model_fields
        own = {key: value for key, value in values.items() if key.partition(".")[0] in fields}
        assumed = {key: value for key, value in values.items() if key not in own}
        truth = assumed.get("truth")
        if isinstance(truth, dict):  # a file that all nodes share says it of all sections
            assumed["truth"] = truth_of(truth, cls.sections)
        return settings_from(cls.settings_model, own, name), scenario_from(assumed, name)

    def changed(self, values: Values) -> None:
        """Take new values of mutable parameters; an InputError refuses them."""

    def advertise(self, topic: Topic, consumers: Collection[str] | None = None) -> Publishing:
        """Return a publisher of one of the graph's topics; `consumers` replaces those of the
        topic."""
        wanted = topic.consumers if consumers is None else consumers
        listeners = [
            name
            for name in self.settings.peers
            if topics.kind_of(name) in wanted and name != self.get_name()
        ]
        self._publishing.append(Publishing(self, topic, len(listeners)))
        return self._publishing[-1]

    def listen(self, topic: Topic, handler: Take, raw: bool = False) -> Listening:
        """Subscribe; a message with which the handler fails is dropped and counted. It has passed
        the node's `Entrance`."""

        def enter(message: topics.Message) -> None:
            now = self.get_clock().now().nanoseconds
            if raw:
                given = topics.type_name(listening.type)
                handler(self._entrance.take_serialised(topic, message, given, now))
            else:
                handler(self._entrance.take(topic, message, now))

        plain = not self._entrance.changes(topic)

        def guarded(message: topics.Message) -> None:
            if self.active:
                as_it_is = plain and listening.type is topic.type
                self.guard(topic, handler if as_it_is else enter, message)

        listening = self.hear(topic, guarded, raw, topic.single)
        return listening

    def hear(self, topic: Topic, take: Take, raw: bool = False, single: bool = False) -> Listening:
        """Subscribe; what `take` raises is raised, and it has to look whether the node is active
        itself.

        Parameters
        ----------
        take : callable
            Takes a message, serialised if `raw`.
        single : bool, optional
            Whether to use one publisher only, see `Listening`.
        """
        self._listening[topic.name] = Listening(self, topic, take, raw, single)
        return self._listening[topic.name]

    def guard(self, topic: Topic, action: Callable[..., None], *arguments: topics.Message) -> None:
        """Do what a message asks for; one with which that fails is dropped and counted."""
        try:
            action(*arguments)
        except BadMessageError as error:
            self.health.drop(topic.name, str(error))
        except Exception as error:
            self.health.drop(topic.name, f"{type(error).__name__}: {error}")
            self.get_logger().error(
                f"{topic.name}: {type(error).__name__}: {error}", throttle_duration_sec=10.0
            )

    def watch(self, name: str, look: Callable[[], str | None], level: bytes = WARN) -> None:
        """Look every second for something that no message tells of; None = all is well."""
        self._looks.append(lambda: self.health.concern(name, look(), level))

    def publishers_of(self, topic: str) -> dict[bytes, str]:
        """Return which nodes publish a topic, by what identifies each publisher: names with their
        namespaces; empty = the middleware knows the publisher, but not its node yet."""
        return {
            bytes(info.endpoint_gid): ""
            if _UNKNOWN in info.node_name
            else f"{info.node_namespace.rstrip('/')}/{info.node_name}"
            for info in self.get_publishers_info_by_topic(topic)
        }

    def offer_reset(self, forget: Callable[[], str]) -> None:
        """Offer the service ``~/reset``; `forget` returns what the node does next."""

        def reset(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            for publishing in self._publishing:
                publishing.newest = None
            response.success, response.message = True, forget()
            return response

        self.create_service(Trigger, "~/reset", reset)

    def log(self, level: bytes, text: str) -> None:
        """Log a line at a level of the diagnostics."""
        logger = self.get_logger()  # which takes one level for each line of code
        if level == OK:
            logger.info(text)
        elif level == WARN:
            logger.warning(text)
        else:
            logger.error(text)

    def missing_listeners(self) -> list[str]:
        """Say which topics have too few listeners."""
        return [missing for one in self._publishing if (missing := one.missing) is not None]

    def fail(self, message: str) -> None:
        """End with an error: diagnostics, one line in the log, exit code 1."""
        self.health.state(ERROR, message)
        self.exit_code, self.failure = 1, message
        self.finished = True

    def received(self) -> int | None:
        """Count the messages taken so far; None = the node need not take what is under way when it
        ends."""
        return None

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deal with messages from now on."""
        if "active" in self.health.figures:  # it has been deactivated before
            self.health.figures["active"] = True
        if self.ready:
            self.health.figures["ready"] = True
        self.health.concern("inactive", None)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let messages go from now on, and say so."""
        self.health.figures |= {"ready": False, "active": False}
        self.health.concern("inactive", "inactive: messages are let go until it is activated")
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Destroy what `setup` made."""
        del self._publishing[1:]
        self._looks.clear()
        self._listening.clear()
        self.ready = False
        self._readiness.reset()
        return super().on_cleanup(state)

    def close(self, timeout: float = 1.0) -> None:
        """Let listeners have what was published, for `timeout` s of wall time at most, then
        destroy the node."""
        deadline = time.monotonic() + timeout
        if self.context.ok():
            self.health.publish()  # the last figures
        for publishing in self._publishing if self.context.ok() else ():
            publishing.wait(deadline)
        self.destroy_node()

    def _check_ready(self) -> None:
        if not self.active:
            return
        missing = self.missing_listeners()
        self.health.figures["ready"] = not missing
        if missing:
            self.health.figures["waiting for listeners"] = ", ".join(missing)
            return
        self.ready = True
        self._readiness.cancel()
        self.get_logger().info("ready")
        if "waiting for listeners" in self.health.figures:
            self.health.figures["waiting for listeners"] = "none"
        if self.health.message == STARTING:
            self.health.state(OK, "ready")

    def _beat(self) -> None:
        """Hear who offers less than is asked for, look at what no message tells of, and publish
        diagnostics while no data comes."""
        for listening in list(self._listening.values()):
            listening.adapt()
        for look in self._looks:
            look()
        self._heartbeat.beat()
