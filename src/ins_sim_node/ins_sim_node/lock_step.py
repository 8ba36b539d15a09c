"""Which answers of the graph a step needs before the next one may come, and what becomes of it
where one cannot come any more."""

from collections.abc import Callable
from functools import partial

from rclpy.serialization import deserialize_message

from ins_sim_node.settings import InsSimSettings
from isogal.matching.batching import fix_due
from isogal.matching.registry import leading_field
from isogal_ros import topics
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.prepared import peek_ns
from isogal_ros.messages.stamps import from_seconds, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import figures_of

STALL = 2.0
"""s of wall time without an answer after which it is asked whether those who answer have
changed."""
SILENT = 10.0
"""s of wall time without an answer after which the diagnostics say which is missing."""


class LockStep:
    """Counts the answers to the step under way, the last of those that were published at once.

    Every step is answered by ``nav/odom`` of its stamp; a scan also by the reduced reading, of
    each field that has one; a batch end also by ``pmht_mm/fix`` of its stamp (a fix, or none). The
    filter answers every message on ``pmht_mm/fix`` with ``nav/odom`` of its newest stamp, so there
    are as many of those as there were fixes, and one more. It listens while the simulator is not
    active, too: an answer that it let go would be waited for in vain once it goes on.

    Nodes may be killed and started again, or deactivated and activated. While one is dead and not
    yet known to be, the simulation waits. As soon as another takes its place, or it is known to be
    gone, the step under way is not waited for any longer; what nobody publishes is not waited for
    until somebody does. A node that is not active counts as one that is gone.

    Parameters
    ----------
    node : GraphNode
        The simulator.
    compare : callable
        Takes the serialised ``nav/odom`` of the step under way.
    go_on : callable
        Called without arguments when the last answer to a step has come, or is not waited for any
        longer.
    """

    def __init__(
        self,
        node: GraphNode[InsSimSettings],
        compare: Callable[[bytes], None],
        go_on: Callable[[], None],
    ) -> None:
        self._node, self._compare, self._go_on = node, compare, go_on
        each = node.scenario.each_field
        self._per_scan = [one.steps_per_scan for one in each]
        self._lead = leading_field(each)
        self._matcher = each[self._lead].matcher
        self._intervals = [from_seconds(one.gravimeter.interval) for one in each]
        self._ns = -1
        """Stamp of the step under way."""
        self._nav = self._fixes = 0
        self._needs: set[str] = set()
        """Answers beside nav that are still to come: fix, and those of `_reading_of`."""
        self._takes_fixes = False
        self.complete = True
        """Whether all answers to the step are there."""
        self._full = True
        """Whether the step was begun while nothing was absent, and nobody has left or come."""
        self._absent: set[str] = set()
        """Answers that nobody gives at present: nav, fix, and those of `_reading_of`."""
        self.changed = False
        """Whether not all may answer: somebody left or came, and no whole step was answered since
        then."""
        self._known: frozenset[bytes] | None = None
        self._topics = {
            "nav": self._hear(topics.NAV_ODOM, self._take_nav),
            "fix": self._hear(topics.FIX, partial(self._take, "fix", self._lead)),
        }
        for field, one in enumerate(each):
            take = partial(self._take, _reading_of(field), field)
            self._topics[_reading_of(field)] = self._hear(adapter_of(one).reduced, take)
        self.not_ready = {name for name in node.settings.peers if name != node.get_name()}
        """Nodes that have not said yet that all their listeners are there."""
        self._peers, self._inactive = frozenset(self.not_ready), set[str]()
        self._space = node.get_namespace().strip("/")
        self._hear(topics.DIAGNOSTICS, self._hear_peers)

    def _hear(self, topic: topics.Topic, take: Callable[[bytes], None]) -> str:
        """Listen to a topic; return its resolved name."""
        guarded = partial(self._node.guard, topic, take)
        return self._node.hear(topic, guarded).topic_name

    def _hear_peers(self, data: bytes) -> None:
        """Note which nodes of the same namespace are ready, and which are not active."""
        if not (self.not_ready or b"active" in data):  # as nearly all are
            return
        for item in deserialize_message(data, topics.DIAGNOSTICS.type).status:
            space, _, name = item.name.rpartition("/")
            if space != self._space or name not in self._peers:
                continue
            figures = figures_of(item)
            if figures.get("ready") == "True":
                self.not_ready.discard(name)
            is_active = figures.get("active") != "False"
            if is_active == (name in self._inactive):
                (self._inactive.discard if is_active else self._inactive.add)(name)
                self._change()
                text = None if is_active else f"goes on without {name}, which is not active"
                self._node.health.concern(f"without {name}", text)

    def start(self) -> None:
        """Take those who answer now as those who will answer."""
        self._known = self._publishers()

    def begin(self, step: int, ns: int) -> None:
        """Start a step; step 0, the start, has no IMU sample and needs no answer."""
        self._ns = ns
        self._nav = self._fixes = 0
        scanned = {k for k, steps in enumerate(self._per_scan) if step > 0 and step % steps == 0}
        self._needs = {_reading_of(k) for k in scanned} - self._absent
        scans = step // self._per_scan[self._lead]
        is_end = self._lead in scanned and fix_due(scans, self._matcher)
        self._takes_fixes = is_end and not self._absent
        self._needs |= {"fix"} if self._takes_fixes else set()
        self.complete = step == 0 or "nav" in self._absent
        self._full = not self._absent

    def without_reading(self, step: int, most: int) -> int:
        """Return how many steps, from one on, may be published at once: no more than `most`, and
        none after one with a reading, to which the graph may answer with a fix. While not all
        answer it is one."""
        if self._absent or self.changed:
            return 1
        return min(most, *(steps - (step - 1) % steps for steps in self._per_scan))

    def _take_nav(self, data: bytes) -> None:
        if peek_ns(data) == self._ns:
            self._compare(data)
            self._nav += 1
        self._check()

    def _take(self, what: str, field: int, data: bytes) -> None:
        """Take a reading of a field, or a fix, which is of that of the lead. In retrodiction mode
        fixes of earlier scans come first. One of an earlier step, which was not waited for, may
        have been answered before this step began. Recorded readings may come up to a scan after
        their stamps."""
        self._fixes += what == "fix" and self._takes_fixes
        if 0 <= self._ns - peek_ns(data) < self._intervals[field]:
            self._needs.discard(what)
        self._check()

    def _check(self) -> None:
        if not (self.complete or self._needs or self._nav < 1 + self._fixes):
            self.complete = True
            if self.changed and self._full:
                self._absent = self.absent()
                if not self._absent:
                    self.changed = False
                    self.start()
                    self._node.health.concern("waiting", None)
                    self._node.get_logger().info("all nodes answer again")
            self._go_on()

    def watch(self, waited: float) -> None:
        """Look after the step under way, which was published `waited` s ago."""
        if self.changed:
            self._absent = self.absent()
        timeout = self._node.settings.reply_timeout
        silent = waited > SILENT and not self.complete
        text = f"waits for an answer: {self._missing()}" if silent else None
        self._node.health.concern("waiting for an answer", text)
        if self.complete:
            # nobody answers it, or it was answered while the simulator was not active
            self._go_on()
        elif waited > STALL and (self.changed or self._publishers() != self._known):
            self._let_go()
        elif waited > timeout:
            self._node.fail(
                f"no answer to the step at {to_seconds(self._ns):.3f} s within {timeout:g} s:"
                f" {self._missing()}"
            )

    def _let_go(self) -> None:
        if not self.changed:
            text = f"a node has left or was started again: {self._missing()}"
            self._node.health.concern("waiting", text)
        self._change()
        self._node.health.count("steps not waited for")
        self._absent = self.absent()
        self.complete = True
        self._go_on()

    def _missing(self) -> str:
        """Say what is still to come."""
        odometry = f"nav/odom ({self._nav} of {1 + self._fixes})"
        lacking = [odometry] if self._nav < 1 + self._fixes else []
        lacking += ["the reduced reading"] if self._needs - {"fix"} else []
        lacking += ["pmht_mm/fix"] if "fix" in self._needs else []
        return f"missing {', '.join(lacking)} of stamp {to_seconds(self._ns):.3f} s"

    def _publishers(self) -> frozenset[bytes]:
        """Return what identifies the publishers of the answers: of a node that was started again
        they are others."""
        return frozenset().union(*map(self._node.publishers_of, self._topics.values()))

    def absent(self) -> set[str]:
        """Return which answers nobody publishes who is active."""
        inactive = {f"{self._node.get_namespace().rstrip('/')}/{name}" for name in self._inactive}
        return {
            what
            for what, topic in self._topics.items()
            if inactive.issuperset(self._node.publishers_of(topic).values())
        }

    def _change(self) -> None:
        """Note that not all may answer, until a whole step has been answered."""
        self.changed, self._full = True, False


def _reading_of(field: int) -> str:
    """Return what the answer of a field is called, by its place in the list of fields."""
    return f"reading {field}" if field else "reading"
