"""The limit of the graph's speed: bare rclpy nodes that send messages of a recording to and fro as
the graph does, in lock-step, and compute nothing.

    .venv/bin/python benchmarks/relay.py BAG DOMAIN [NODE ...]

One process with the nodes that are named, or all; `benchmarks/graph.py --limit` starts it. The one
with the simulator prints a line when the steps begin, and at the end one with their number and
how many seconds they took."""

import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from rclpy.context import Context
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.domain import local_context
from isogal_ros.nodes.spin import Spinning, make_executor
from isogal_ros.topics import LOSSLESS, Message, Topic

RECORDER = "recorder"
NODES = (RECORDER, topics.GRAVIMETER, topics.PMHT_MM, topics.UKF_FUSION, topics.INS_SIM)
STEP = (topics.CLOCK, topics.IMU, topics.TRUTH_ODOM, topics.INS_FIX, topics.TRUTH_FIX)
STATE = (
    topics.NAV_ODOM, topics.PROTECTION_LEVEL, topics.NAV_COVARIANCE, topics.NAV_FIX,
    topics.NAV_PATH,
)  # fmt: skip
REDUCED = (topics.GRAVITY, topics.DISTURBANCE)
FIX = (topics.INFORMATION, topics.FIX, topics.POSE, topics.CANDIDATES)
SENT = (*STEP, *STATE, topics.GRAVIMETRY, *REDUCED, *FIX)
SETTLED = 1.0
"""s for which all have found each other before the first step: what one process sees of another
is not yet seen the other way."""


class Sample:
    """One message of each topic of a recording, and how often they come: that in the middle, as
    paths grow, and what is said of a fix begins with the first."""

    def __init__(self, bag: Path) -> None:
        types = {f"/{topic.name.lstrip('/')}": topic.type for topic in SENT}
        self.messages: dict[str, Message] = {}
        reader, seen = BagReader(bag), Counter[str]()
        counts = Counter(item.topic for item in reader.messages())
        for item in reader.messages():
            seen[item.topic] += 1
            if item.topic in types and seen[item.topic] == (1 + counts[item.topic]) // 2:
                message = deserialize_message(item.data, types[item.topic])
                # rclpy takes longer for the poses of a path than for all else of a step
                is_path = types[item.topic] is topics.NAV_PATH.type
                self.messages[item.topic] = item.data if is_path else message
        self.steps = counts["/clock"]
        self.scan_every = round(self.steps / counts["/gravimeter/gravity"])
        self.fix_every = self.scan_every * max(
            1, round(counts["/gravimeter/gravity"] / counts["/pmht_mm/fix"])
        )


class Relay(Node):
    """One node with the graph's subscriptions and publishers, which counts what it hears."""

    def __init__(self, name: str, sample: Sample, context: Context) -> None:
        super().__init__(f"bare_{name}", context=context)
        self.sample, self.finished = sample, False
        self.finish: Callable[[], None] = lambda: None
        """Called once it has."""
        self._heard: Counter[Topic] = Counter()
        self._outputs: dict[Topic, Callable[[], None]] = {}
        self._made = []
        make = {
            RECORDER: self._record,
            topics.INS_SIM: self._simulate,
            topics.GRAVIMETER: self._measure,
            topics.PMHT_MM: self._match,
            topics.UKF_FUSION: self._navigate,
        }
        make[name]()

    def _hear(
        self, topic: Topic, act: Callable[[], None] = lambda: None, raw: bool = True
    ) -> None:
        def take(_message: Message) -> None:
            self._heard[topic] += 1
            act()

        self.create_subscription(topic.type, topic.name, take, LOSSLESS, raw=raw)

    def _offer(self, sent: Sequence[Topic]) -> None:
        for topic in sent:
            message = self.sample.messages[f"/{topic.name.lstrip('/')}"]
            made = self.create_publisher(topic.type, topic.name, LOSSLESS)
            self._made.append(made)
            self._outputs[topic] = lambda publish=made.publish, what=message: publish(what)

    def _send(self, sent: Sequence[Topic]) -> None:
        for topic in sent:
            self._outputs[topic]()

    def _record(self) -> None:
        for topic in SENT:
            self._hear(topic)

    def _navigate(self) -> None:
        self._offer(STATE)
        self._hear(topics.INFORMATION, raw=False)
        for topic in (topics.IMU, topics.FIX):
            self._hear(topic, lambda: self._send(STATE), raw=False)

    def _measure(self) -> None:
        self._offer((topics.GRAVIMETRY, *REDUCED))

        def read() -> None:
            if self._heard[topics.TRUTH_FIX] % self.sample.scan_every == 0:
                self._send((topics.GRAVIMETRY, *REDUCED))

        self._hear(topics.TRUTH_FIX, read)
        for topic in (topics.NAV_ODOM, topics.NAV_COVARIANCE, topics.NAV_FIX):
            self._hear(topic)

    def _match(self) -> None:
        self._offer(FIX)
        scans = self.sample.fix_every // self.sample.scan_every

        def scan() -> None:
            if self._heard[topics.GRAVITY] % scans == 0:
                self._send(FIX)

        self._hear(topics.GRAVITY, scan, raw=False)
        for topic in (topics.NAV_ODOM, topics.NAV_COVARIANCE, topics.NAV_FIX):
            self._hear(topic)

    def _simulate(self) -> None:
        self._step, self.begun, self._found = 0, 0.0, time.monotonic()
        self._offer(STEP)
        for topic in (topics.NAV_ODOM, topics.GRAVITY, topics.FIX):
            self._hear(topic, self._check)
        self._timer = self.create_timer(0.05, self._begin)

    def _begin(self) -> None:
        """Begin once all publishers and listeners of the graph have found each other: the
        recorder, and those who cannot do without a topic."""
        listeners = {topics.IMU: 2, topics.TRUTH_FIX: 2, topics.NAV_ODOM: 4, topics.GRAVITY: 3}
        listeners |= {topics.FIX: 3, topics.INFORMATION: 2}
        found = all(self.count_subscribers(t.name) >= n for t, n in listeners.items())
        if not (found and all(self.count_publishers(topic.name) for topic in SENT)):
            self._found = time.monotonic()
        elif time.monotonic() - self._found > SETTLED:
            self._timer.cancel()
            print("begun", flush=True)
            self.begun = time.monotonic()
            self._send(STEP)
            self._step = 1

    def _check(self) -> None:
        """Go on with the next step when this one has all its answers."""
        step, sample = self._step, self.sample
        scans, fixes = step // sample.scan_every, step // sample.fix_every
        wanted = {topics.NAV_ODOM: step + fixes, topics.GRAVITY: scans, topics.FIX: fixes}
        if any(self._heard[topic] < count for topic, count in wanted.items()):
            return
        if step == sample.steps:
            self.finished = True
            self.finish()
            return
        self._step += 1
        self._send(STEP)


def main() -> None:
    bag, domain, *names = sys.argv[1:]
    sample = Sample(Path(bag))
    with local_context(int(domain)) as context:
        executor = make_executor(context)
        nodes = [Relay(name, sample, context) for name in names or NODES]
        for node in nodes:
            executor.add_node(node)
        last, spinning = nodes[-1], Spinning(executor)
        last.finish = spinning.stop
        while not last.finished and context.ok():
            spinning.spin(0.2)
        if last.finished:
            print(sample.steps, time.monotonic() - last.begun, flush=True)
            sys.stdin.readline()  # its processor time is looked at before it ends
        executor.shutdown()


if __name__ == "__main__":
    main()
