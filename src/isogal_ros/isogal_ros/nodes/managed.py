"""A managed node (REP-2002): unconfigured, inactive, active.

Configured, it has its publishers and subscriptions; messages that come while it is not active are
let go; cleaned up, it can be configured anew."""

from collections.abc import Mapping
from typing import ClassVar, TypeAlias

from pydantic import JsonValue
from rclpy.client import Client
from rclpy.context import Context
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from isogal.errors import InputError

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
Entity: TypeAlias = Publisher | Subscription | Timer | Service | Client


class ManagedNode(LifecycleNode):
    """A node that makes what it has when it is configured, and destroys it when it is cleaned up.

    Parameters
    ----------
    name : str
        Node name.
    values : mapping, optional
        Parameter values by dotted name. None = from the command line and parameter files, as `ros2
        run` gives them.
    context : Context, optional
        None = the default context.
    """

    entities: ClassVar[tuple[str, ...]] = (
        "publishers", "subscriptions", "timers", "services", "clients",
    )  # fmt: skip
    """What a node is made of, and destroys in the end."""
    process_ends = False
    """Whether nothing comes after the node in its process."""

    def __init__(
        self,
        name: str,
        values: Mapping[str, JsonValue] | None = None,
        context: Context | None = None,
    ) -> None:
        self.active = self.configured = False
        """Whether messages are dealt with, and whether there is what deals with them."""
        self.finished = False
        """Whether the node has nothing left to do, so that its process may end."""
        self._failed: BaseException | None = None
        self._before: dict[str, set[Entity]] = {}
        super().__init__(
            name,
            context=context,
            use_global_arguments=values is None,
            parameter_overrides=None
            if values is None
            else [Parameter(key, value=value) for key, value in values.items()],
            automatically_declare_parameters_from_overrides=True,
        )

    def setup(self) -> None:
        """Make publishers and subscriptions; a graph's node has its scenario, settings and health
        by then."""

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
            self._destroy_made(self._before)
            if not isinstance(error, InputError | KeyboardInterrupt):
                self.get_logger().error(f"{type(error).__name__}: {error}")
            return FAILURE
        self.configured = True
        return SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deal with messages from now on."""
        self.active = True
        return SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let messages go from now on."""
        self.active = False
        return SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Destroy what `setup` made."""
        self.active = self.configured = False
        self._destroy_made(self._before)
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the node's process."""
        self.active = False
        self.finished = True
        return SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go back to unconfigured."""
        return self.on_cleanup(state)

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
        if self.process_ends:
            self._destroy_made({})
            return
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()
