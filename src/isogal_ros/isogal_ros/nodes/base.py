"""The base of every node of the graph: parameters, states, guarded subscriptions, diagnostics,
readiness.

A node is a managed one (REP-2002): unconfigured, inactive, active. Configured, it has its
publishers and subscriptions; messages that come while it is not active are let go; cleaned up, it
can be configured anew. One that starts by itself (the parameter `autostart`, the default) is
active once it is made."""

import time
from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeAlias

from lifecycle_msgs.srv import ChangeState
from pydantic import JsonValue
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from std_srvs.srv import Trigger
from typing_extensions import TypeVar

from isogal.errors import InputError
from isogal.scenario import Scenario, truth_of, validate_scenario, validated
from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.drivers import Entrance
from isogal_ros.messages.mounting import mounted, placed
from isogal_ros.messages.prepared import decoded
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.health import ERROR, OK, STARTING, WARN, Health
from isogal_ros.nodes.heartbeat import Heartbeat
from isogal_ros.nodes.listening import Listening, Take
from isogal_ros.nodes.publishing import Publishing
from isogal_ros.nodes.settings import NodeSettings
from isogal_ros.nodes.static_transforms import static_transforms
from isogal_ros.parameters.declaration import declare
from isogal_ros.parameters.from_model import ParameterSpec, parameter_specs
from isogal_ros.parameters.values import Values, nested
from isogal_ros.topics import Topic

if TYPE_CHECKING:
    from isogal_ros.graph.bus import Bus

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
Settings_co = TypeVar("Settings_co", bound=NodeSettings, covariant=True, default=NodeSettings)
Entity: TypeAlias = Publisher | Subscription | Timer | Service | Client
KEYS = frozenset(spec.name for spec in parameter_specs(Scenario))
"""Of a scenario, which a file that all nodes share may say to each."""
_UNKNOWN = "NODE_NAME_UNKNOWN"
"""In the name of a node of which the middleware knows the publisher first."""


class GraphNode(LifecycleNode, Generic[Settings_co]):
    """A node with the parameters of some sections of the scenario and its own. It makes what it
    has when it is configured, and destroys it when it is cleaned up.

    Parameters
    ----------
    name : str
        Node name.
    values : mapping, optional
        Parameter values by dotted name. None = from the command line and parameter files, as `ros2
        run` gives them.
    context : Context, optional
        None = the default context.

    Raises
    ------
    InputError
        A parameter is unknown or bad.
    """

    sections: ClassVar[Collection[str]] = ()
    """Sections of the scenario that the node declares."""
    settings_model: ClassVar[Any] = NodeSettings
    """Class of its own parameters, a `NodeSettings`; a class variable cannot say that it is that
    of `settings`."""
    mutable: ClassVar[Collection[str]] = ()
    """Parameters that may change at run time."""
    entities: ClassVar[tuple[str, ...]] = (
        "publishers", "subscriptions", "timers", "services", "clients",
    )  # fmt: skip
    """What a node is made of, and destroys in the end."""
    process_ends = False
    """Whether nothing comes after the node in its process."""

    settings: Settings_co
    """Own parameters, a `settings_model`."""
    scenario: Scenario

    def __init__(
        self,
        name: str,
        values: Mapping[str, JsonValue] | None = None,
        context: Context | None = None,
    ) -> None:
        self.active = self.configured = False
        """Whether messages are dealt with, and whether there is what deals with them."""
        self._finished = False
        self.told: Callable[[], None] = lambda: None
        """Called when the node has finished."""
        self._failed: BaseException | None = None
        self._before: dict[str, set[Entity]] = {}
        overrides = [Parameter(key, value=value) for key, value in (values or {}).items()]
        super().__init__(
            name,
            context=context,
            use_global_arguments=values is None,
            parameter_overrides=overrides,
            automatically_declare_parameters_from_overrides=True,
        )
        self._guard_transitions()
        self._join(context)
        self.exit_code = 0
        self.failure = ""
        """Why the node failed, where it did."""
        self.publishing: list[Publishing] = []
        """The first is of the diagnostics."""
        self.listening: dict[str, Listening] = {}
        self._monitors: list[Callable[[], None]] = []
        self.ready = False
        """Whether every publisher has had the listeners that the graph needs."""
        try:
            declare(self, self.specs(), KEYS, self._accept, self._change)
            self.frame_names = self.settings.frame_names
            self._mount()
            full_name = self.get_fully_qualified_name().lstrip("/")
            self.health = Health(full_name, self.advertise(topics.DIAGNOSTICS), self.log)
            steady, self._heartbeat = Clock(clock_type=ClockType.STEADY_TIME), Heartbeat(self)
            # made before `setup` makes anything, so that they outlive a cleanup
            self.create_timer(1.0, self._beat, clock=steady)
            period = self.settings.diagnostics_period
            self.create_timer(period, self.health.renew, clock=steady)
            self._readiness = self.create_timer(0.02, self._check_ready, clock=steady)
            if self.settings.autostart:
                self.start()
        except BaseException:
            self.destroy_node()
            raise

    def _join(self, context: Context | None) -> None:
        """Note the bus that carries the node's messages, where its context is one."""
        self.bus: Bus | None = getattr(context, "bus", None)
        """None = the middleware carries them."""
        quiet = self.bus is not None and self.bus.quiet
        level = LoggingSeverity.FATAL if quiet else LoggingSeverity.UNSET
        set_logger_level(self.get_logger().name, level)
        self.monotonic = time.monotonic
        if (bus := self.bus) is not None and bus.alone:
            self.monotonic = lambda: bus.now  # there is no wall time but that of the data

    def _guard_transitions(self) -> None:
        """Refuse a transition that the node's state does not have: rclpy raises, which would end
        the process of whoever is asked."""

        def guarded(
            ask: Callable[[ChangeState.Request, ChangeState.Response], ChangeState.Response],
            request: ChangeState.Request,
            response: ChangeState.Response,
        ) -> ChangeState.Response:
            try:
                return ask(request, response)
            except rclpy_implementation.RCLError:
                number = request.transition.id
                self.log(WARN, f"change_state: no transition {number} from the node's state")
                response.success = False
                return response

        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = partial(guarded, service.callback)

    def _mount(self) -> None:
        """Note how messages of sensors come, and where the sensors are."""
        entrance = Entrance(self.settings.drivers, self.frame_names)
        look = partial(static_transforms, self.context, self.settings.tf_timeout)
        self._entrance = placed(entrance, look)
        self.scenario = mounted(self.scenario, self._entrance.drivers)

    @property
    def finished(self) -> bool:
        """Whether the node has nothing left to do, so that its process may end."""
        return self._finished

    @finished.setter
    def finished(self, is_so: bool) -> None:
        self._finished = is_so
        if is_so:
            self.told()

    @classmethod
    def specs(cls) -> list[ParameterSpec]:
        """Return the parameters: own ones, and those of the sections of the scenario."""
        own = parameter_specs(cls.settings_model, mutable=cls.mutable)
        return own + parameter_specs(Scenario, sections=cls.sections, mutable=cls.mutable)

    @classmethod
    def read(cls, name: str, values: Values) -> tuple[Settings_co, Scenario]:
        """Return settings and scenario of the values of all parameters; raises InputError, which
        begins with a name."""
        fields = cls.settings_model.model_fields
        own = {key: value for key, value in values.items() if key.partition(".")[0] in fields}
        assumed = {key: value for key, value in values.items() if key not in own}
        truth = assumed.get("truth")
        if isinstance(truth, dict):  # a file that all nodes share says it of all sections
            assumed["truth"] = truth_of(truth, cls.sections)
        settings = validated(cls.settings_model, nested(own), where=f"{name}: ")
        return settings, validate_scenario(nested(assumed), name)

    def _accept(self, values: Values) -> None:
        self.settings, self.scenario = self.read(self.get_name(), values)

    def _change(self, values: Values) -> None:
        if self.configured:
            self.changed(values)

    def changed(self, values: Values) -> None:
        """Take new values of mutable parameters; an InputError refuses them."""

    def advertise(self, topic: Topic, consumers: Collection[str] | None = None) -> Publishing:
        """Return a publisher of one of the graph's topics; `consumers` replaces those of the
        topic."""
        wanted = topic.consumers if consumers is None else consumers
        others = [name for name in self.settings.peers if name != self.get_name()]
        listeners = sum(topics.kind_of(name) in wanted for name in others)
        self.publishing.append(Publishing(self, topic, listeners))
        return self.publishing[-1]

    def listen(
        self, topic: Topic, handler: Callable[[topics.Message], None], raw: bool = False
    ) -> Listening:
        """Subscribe; a message with which the handler, which takes it serialised if `raw`, fails
        is dropped and counted. It has passed the node's `Entrance`."""
        plain = not self._entrance.changes(topic)

        def enter(data: bytes) -> None:
            if not (plain and listening.type is topic.type):
                given = topics.type_name(listening.type)
                data = self._entrance.take_serialised(topic, data, given, self.now_ns())
            handler(data if raw else decoded(data, topic.type))

        def guarded(data: bytes) -> None:
            if self.active:
                self.guard(topic, enter, data)

        listening = self.hear(topic, guarded, topic.single)
        return listening

    def now_ns(self) -> int:
        """Return the time of the node's clock, ns; on a bus without others that of the data."""
        if self.bus is not None and self.bus.alone:
            return from_seconds(self.bus.now)
        return int(self.get_clock().now().nanoseconds)

    def hear(self, topic: Topic, take: Take, single: bool = False) -> Listening:
        """Subscribe, see `Listening`; what `take` raises is raised, and it has to look whether the
        node is active itself."""
        self.listening[topic.name] = Listening(self, topic, take, single)
        return self.listening[topic.name]

    def guard(self, topic: Topic, action: Callable[..., None], *arguments: topics.Message) -> None:
        """Do what a message asks for; one with which that fails is dropped and counted."""
        try:
            action(*arguments)
        except BadMessageError as error:
            self.health.drop(topic.name, str(error))
        except Exception as error:
            why = f"{type(error).__name__}: {error}"
            self.health.drop(topic.name, why)
            self.log(ERROR, f"{topic.name}: {why}", throttle_duration_sec=10.0)

    def watch(self, name: str, check: Callable[[], str | None], level: bytes = WARN) -> None:
        """Check every second something that no message tells of; None = all is well."""
        self._monitors.append(lambda: self.health.concern(name, check(), level))

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
            for publishing in self.publishing:
                publishing.newest = None
            response.success, response.message = True, forget()
            return response

        self.create_service(Trigger, "~/reset", reset)

    def log(self, level: bytes, text: str, **options: float) -> None:
        """Log a line at a level of the diagnostics."""
        logger = self.get_logger()  # which takes one level, and set of options, for each line
        if level == OK:
            logger.info(text)
        elif level == WARN:
            logger.warning(text)
        elif options:
            logger.error(text, **options)
        else:
            logger.error(text)
        if level == ERROR and self.bus is not None:
            self.bus.errors.append(f"{logger.name}: {text}")

    def missing_listeners(self) -> list[str]:
        """Say which topics have too few listeners."""
        return [missing for one in self.publishing if (missing := one.missing)]

    def fail(self, message: str) -> None:
        """End with an error: diagnostics, one line in the log, exit code 1."""
        self.health.state(ERROR, message)
        self.exit_code, self.failure = 1, message
        self.finished = True

    def received(self) -> int | None:
        """Count the messages taken so far; None = the node need not take what is under way when it
        ends."""
        return None

    def setup(self) -> None:
        """Make publishers and subscriptions; scenario, settings and health are there by then."""

    def start(self) -> None:
        """Configure and activate; raises what `setup` raises."""
        self.trigger_configure()
        if self._failed is not None:
            raise self._failed
        self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make what the node has; a failure leaves it unconfigured."""
        self._before = {kind: set(getattr(self, kind)) for kind in self.entities}
        self._failed = None
        try:
            self.setup()
        except BaseException as error:
            self._failed = error
            self._unmake()
            if not isinstance(error, InputError | KeyboardInterrupt):
                self.get_logger().error(f"{type(error).__name__}: {error}")
            return FAILURE
        self.configured = True
        return SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deal with messages from now on."""
        if "active" in self.health.figures:  # it has been deactivated before
            self.health.figures["active"] = True
        if self.ready:
            self.health.figures["ready"] = True
        self.health.concern("inactive", None)
        self.active = True
        return SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let messages go from now on, and say so."""
        self.health.figures |= {"ready": False, "active": False}
        self.health.concern("inactive", "inactive: messages are let go until it is activated")
        self.active = False
        return SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Destroy what `setup` made."""
        self.active = self.configured = self.ready = False
        self._readiness.reset()
        self._unmake()
        return SUCCESS

    def _unmake(self) -> None:
        """Forget and destroy what `setup` made."""
        del self.publishing[1:]
        self._monitors.clear()
        self.listening.clear()
        if self.bus is not None:
            self.bus.silence(self)
        self._destroy_made(self._before)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go back to unconfigured."""
        return self.on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the node's process."""
        self.active = False
        self.finished = True
        return SUCCESS

    def close(self, timeout: float = 1.0) -> None:
        """Let listeners have what was published, for `timeout` s of wall time at most, then
        destroy the node."""
        deadline = time.monotonic() + timeout
        if self.context.ok():
            self.health.publish()  # the last figures
            for publishing in self.publishing:
                publishing.wait(deadline)
        self.destroy_node()

    def _destroy_made(self, but: Mapping[str, set[Entity]]) -> None:
        for kind in self.entities:
            destroy = getattr(self, f"destroy_{kind[:-1]}")
            for entity in set(getattr(self, kind)) - but.get(kind, set()):
                destroy(entity)

    def destroy_node(self) -> None:
        """Destroy the node, and its states, which rclpy leaves to the search for garbage: until
        then others see the node and what it publishes.

        At the end of its process, only what it publishes and listens to: Fast DDS 2.14 waits for
        ever, with Python's lock, where it takes itself down while it hears of others that do so
        (`DomainParticipant::set_listener` and a discovery callback wait for each other)."""
        if self.bus is not None:
            self.bus.leave(self)
        if self.process_ends:
            self._destroy_made({})
            return
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def _check_ready(self) -> None:
        if not self.active:
            return
        missing, figures = self.missing_listeners(), self.health.figures
        figures["ready"] = not missing
        if missing or "waiting for listeners" in figures:
            figures["waiting for listeners"] = ", ".join(missing) or "none"
        if missing:
            return
        self.ready = True
        self._readiness.cancel()
        self.get_logger().info("ready")
        if self.health.message == STARTING:
            self.health.state(OK, "ready")

    def _beat(self) -> None:
        """Hear who offers less than is asked for, and look at what no message tells of."""
        for listening in list(self.listening.values()):
            listening.adapt()
        for monitor in self._monitors:
            monitor()
        self._heartbeat.beat()
