"""Nodes that are killed and started again, or deactivated and activated: those who answer, and the
simulator itself."""

from typing import Any

from ins_sim_node.answers import Answers
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.checkpoint import Checkpoint

STALL = 2.0
"""s of wall time without an answer after which it is asked whether those who answer have
changed."""


class Successors:
    """Lets a step go whose answer cannot come any more because who would have given it is gone.

    While a node is dead and not yet known to be, the simulation waits. As soon as another takes
    its place, or it is known to be gone, the step under way is not waited for any longer; what
    nobody publishes is not waited for until somebody does. A node that is not active counts as one
    that is gone.

    Parameters
    ----------
    node : GraphNode
        The simulator.
    answers : Answers
        Whose answers it waits for.
    """

    def __init__(self, node: Any, answers: Answers) -> None:
        self._node, self._answers = node, answers
        self._changed = False
        self._answered = self._forgotten = 0
        self._without: set[str] = set()
        answers.activity.told = self._note

    def _note(self, name: str, active: bool) -> None:
        """Take a node that answers as gone, or as back."""
        self._change()
        if active:
            self._without.discard(name)
            self._node.health.concern(f"without {name}", None)
        else:
            self._without.add(name)
            self._node.health.concern(
                f"without {name}", f"goes on without {name}, which is not active"
            )

    def _change(self) -> None:
        """Note that not all may answer, until a whole step has been answered."""
        self._changed = True
        self._answered = self._answers.lock_step.answered

    def begin(self) -> None:
        """Note who answers."""
        self._answers.note_peers()

    def watch(self, waited: float) -> None:
        """Look after the step under way, which was published `waited` s ago."""
        step = self._answers.lock_step
        if self._changed:
            step.absent = self._answers.absent()
            if step.absent:
                self._answered = step.answered
            elif step.answered > self._answered:
                self._all_again()
        if step.complete:
            # nobody answers it, or it was answered while the simulator was not active
            self._node.resume()
            return
        if waited > STALL and (self._changed or self._answers.peers_changed()):
            self._let_go()
        elif waited > self._node.settings.reply_timeout:
            self._node.fail(
                f"no answer to the step at {to_seconds(step.ns):.3f} s within"
                f" {self._node.settings.reply_timeout:g} s: {step.missing()}"
            )

    def _all_again(self) -> None:
        self._changed = False
        self._answers.note_peers()
        for name in ("waiting", *(f"without {name}" for name in self._without)):
            self._node.health.concern(name, None)
        self._without.clear()
        self._node.get_logger().info("all nodes answer again")

    def _let_go(self) -> None:
        step = self._answers.lock_step
        if not self._changed:
            text = f"a node has left or was started again: {step.missing()}"
            self._node.health.concern("waiting", text)
        self._change()
        self._forgotten += 1
        self._node.health.figures["steps not waited for"] = self._forgotten
        step.absent = self._answers.absent()
        step.forget()
        self._node.resume()


class Survival:
    """The simulator's own checkpoint: how far it is. All else it simulates anew."""

    def __init__(self, node: GraphNode) -> None:
        self._checkpoint = Checkpoint(node)
        found = self._checkpoint.found
        self.step = found.content if found is not None and isinstance(found.content, int) else -1
        """Step published last; -1 = none."""
        if self.step >= 0:
            node.get_logger().info(f"goes on after step {self.step}")

    def forget(self) -> None:
        """Delete it: the route has ended."""
        self._checkpoint.forget()

    def keep(self, step: int) -> None:
        """Note a step before it is published: it is never published twice."""
        self._checkpoint.save(0, step)
