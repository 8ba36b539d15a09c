"""The states of a node: unconfigured, inactive, active (REP-2002's managed nodes).

A node that starts by itself (the parameter `autostart`, the default) is active once it is made.
Configured, it has its publishers and subscriptions; messages that come while it is not active are
let go; cleaned up, it can be configured anew."""

from typing import Any

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from isogal.errors import InputError

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
_ENTITIES = ("publishers", "subscriptions", "timers", "services", "clients")


class ManagedNode(LifecycleNode):
    """A node that makes all it has in `setup` and says `begin` and `pause` of itself."""

    def __init__(self, name: str, **keys: Any) -> None:
        self.active = False
        """Whether messages are dealt with."""
        self.configured = False
        self._failed: BaseException | None = None
        self._before: dict[str, set[Any]] = {}
        super().__init__(name, **keys)

    def setup(self) -> None:
        """Make publishers and subscriptions."""

    def ended(self) -> None:
        """Note that the node was shut down."""

    def destroy_node(self) -> None:
        """Destroy the node, and its states, which rclpy leaves to the search for garbage: until
        then others see the node and what it publishes."""
        super().destroy_node()
        states = getattr(self, "_state_machine", None)
        if states is not None:  # a graph without middleware has none
            states.destroy_when_not_in_use()

    def start(self) -> None:
        """Configure and activate; raises what `setup` raises."""
        self.trigger_configure()
        if self._failed is not None:
            raise self._failed
        self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make what the node has; a failure leaves it unconfigured."""
        self._before = {kind: set(getattr(self, kind)) for kind in _ENTITIES}
        self._failed = None
        try:
            self.setup()
        except BaseException as error:
            self._failed = error
            self._destroy_made()
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
        self._destroy_made()
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the node's process."""
        self.active = False
        self.ended()
        return SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go back to unconfigured."""
        return self.on_cleanup(state)

    def _destroy_made(self) -> None:
        for kind in _ENTITIES:
            destroy = getattr(self, f"destroy_{kind[:-1]}")
            for entity in set(getattr(self, kind)) - self._before[kind]:
                destroy(entity)
