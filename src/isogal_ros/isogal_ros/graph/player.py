"""What a replay needs of a bag, and fresh nodes that it is played to, past the middleware, step by
step: every sample and reading is dealt with before the next.

The instruments' own readings are reduced anew: sensed gravity is reduced with the navigator's
velocity, and what is matched is taken for reduced with that of the navigator that matches
(docs/mathematics.md, section 2.6). Where a bag has not all of them, readings are taken as they
were reduced when they were recorded."""

import math
from collections import deque
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

from pydantic import JsonValue

from isogal.errors import InputError
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.inertial.rotations import to_angles
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.record import Collector, wanted_messages
from isogal_ros.graph.bus import Bus
from isogal_ros.graph.parameter_files import leaves
from isogal_ros.graph.plan import Plan
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.aids import each_aid
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import map_frame
from isogal_ros.messages.ins_solution import inertial_topics
from isogal_ros.messages.mounting import mounted
from isogal_ros.messages.prepared import peek_ns
from isogal_ros.messages.stamps import from_seconds, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.nav_queue import moved, read_nav
from isogal_ros.topics import Topic

_REDUCTION: Mapping[str, bool | set[str]] = {
    "field": True,
    "gravimeter": {"quantity", "interval", "lever_arm"},
    "magnetometer": True,
    "altimeter": True,
    "gradiometer": {"components"},
}
"""Keys of a scenario that readings are reduced by."""
Start = dict[str, JsonValue]
"""Parameters of ukf_fusion_node by name."""
LATE = 60.0
"""s after which the first IMU sample of a bag is not that of the scenario's start."""


@dataclass(frozen=True)
class Recorded:
    """What a replay needs of a bag."""

    scenario: Scenario
    run: int
    collector: Collector
    sensors: Mapping[Topic, Mapping[int, bytes]]
    """Serialised messages of what is played, by topic and stamp (ns): sensors beside the IMU, the
    IMU or an INS, and the readings."""
    readings: tuple[Topic, ...]
    """Topics of the readings among them."""
    reduces: bool
    """Whether these are those of the instruments, which are reduced anew."""
    start: Start | None = None
    """Where the recorded navigator started; None = the bag does not say it."""

    @property
    def first(self) -> float:
        """Stamp of the first IMU sample, or solution of an INS, s."""
        return to_seconds(min(self.sensors[self.inertial]))

    @property
    def inertial(self) -> Topic:
        """What moves the filter on: samples of the IMU, or the solution of an INS."""
        return inertial_topics(self.scenario.ins)[-1]

    def in_order(self) -> list[tuple[int, Topic, bytes]]:
        """Return when messages come (ns), topics and messages in order of time; of one time in
        that of `sensors`. They come at their stamps, those of aids later by their delay."""
        late = {
            topic: from_seconds(aid.settings.delay)
            for aid in each_aid(self.scenario)
            for topic in (aid.topic, *aid.instead)
        }
        found = [
            (ns + late.get(topic, 0), topic, data)
            for topic, messages in self.sensors.items()
            for ns, data in messages.items()
        ]
        return sorted(found, key=lambda one: one[0])


def load(reader: BagReader, scenario: Scenario) -> Recorded:
    """Read a bag; raises InputError where a topic is missing that is needed, or the scenario
    reduces readings as the bag does not allow."""
    scenario = mounted(scenario, reader.entrance.drivers)
    collector = Collector(scenario)
    each = [adapter_of(one) for one in scenario.each_field]
    raw, inertial = tuple(one.raw for one in each), inertial_topics(scenario.ins)
    if topics.MAGNETIC_FIELD in raw:
        raw += (topics.SCALAR_FIELD,)
    either = [(aid.topic, *aid.instead) for aid in each_aid(scenario)]
    aids = tuple(topic for one in either for topic in one)
    sensors: dict[Topic, dict[int, bytes]] = {one: {} for one in (*aids, *inertial, *raw)}
    odometry: dict[int, bytes] = {}
    wanted = (*sensors, topics.NAV_ODOM, *collector.topics())
    for topic, data in wanted_messages(reader, wanted):
        if topic in sensors:
            sensors[topic][peek_ns(data)] = data
        elif topic is topics.NAV_ODOM:
            if not odometry.keys() & collector.first_nav.keys():
                odometry[peek_ns(data)] = data
        else:
            collector.take(topic, data)
    # those that a scenario takes from a file are published as if they were the instrument's own
    from_file = any(one.readings.source is not None for one in scenario.each_field)
    reduces = all(sensors[one.raw] for one in each) and not from_file
    _check_reduction(reader, scenario, reduces)
    if not reduces:
        for topic in raw:
            del sensors[topic]
        stores = (collector.readings, *collector.others)
        sensors |= {one.reduced: store for one, store in zip(each, stores, strict=True)}
    needed = (*inertial, *(one.raw if reduces else one.reduced for one in each))
    needed += tuple(one[0] for one in either if not any(sensors[topic] for topic in one))
    _check_there(reader, [topic.name for topic in needed if not sensors[topic]])
    return Recorded(
        scenario,
        int(reader.texts.get("run", 0)),
        collector,
        sensors,
        tuple(topic for topic in sensors if topic not in (*aids, *inertial)),
        reduces,
        _start(scenario, collector.first_nav, odometry, min(sensors[inertial[-1]])),
    )


def _check_there(reader: BagReader, missing: list[str]) -> None:
    """Raise InputError where topics are missing."""
    if missing:
        there = ", ".join(sorted(reader.types)) or "nothing"
        cut = f"; {reader.cut}" if reader.cut else ""
        raise InputError(
            f"{reader.path}: no messages on {' and '.join(missing)}, which a replay by this"
            " scenario needs; those of another name are taken by --remap"
            f" /TOPIC:={missing[0]}; the bag has {there}{cut}"
        )


def _check_reduction(reader: BagReader, now: Scenario, raw: bool) -> None:
    """Raise InputError where a scenario reduces readings otherwise than the recorded one did, and
    the bag does not allow it; `raw`: it has all that the instruments measured."""
    recorded, path = reader.scenario(), reader.path
    before, after = _keys_of(recorded or now), _keys_of(now)
    changed = [key for key in after if key not in before or after[key] != before[key]]
    if changed and not raw:
        raise InputError(
            f"{path}: a replay cannot change {', '.join(changed)}: the readings in the bag are"
            " reduced, and it has not all that the instrument measured"
        )
    for key in changed:
        was, now_is = before.get(key), after[key]
        of_scans = key.endswith("gravimeter.interval")
        if of_scans and isinstance(was, float) and isinstance(now_is, float) and now_is < was:
            raise InputError(f"{path}: a replay cannot make {key} shorter than it was ({was:g} s)")


def _keys_of(scenario: Scenario) -> dict[str, JsonValue]:
    """Return the keys that the readings of each field are reduced by."""
    found: dict[str, JsonValue] = {}
    for n, one in enumerate(scenario.each_field):
        prefix = "" if scenario.fields is None else f"fields.{n}."
        found |= leaves(one.model_dump(include=_REDUCTION), prefix)
    return found


def _start(
    scenario: Scenario, fixes: dict[int, bytes], odometry: dict[int, bytes], first: int
) -> Start | None:
    """Return the start; None where the bag does not say it.

    Parameters
    ----------
    fixes, odometry : dict
        Serialised messages on nav/fix and nav/odom by stamp (ns); of the latter those up to
        the first that both have.
    first : int
        Stamp (ns) of the first IMU sample, before which the filter starts by one interval, or of
        the first solution of an INS, at which it starts.
    """
    both = sorted(ns for ns in odometry if ns in fixes)
    if not both:
        return None
    try:
        sample = read_nav(fixes[both[0]], odometry[both[0]], map_frame(scenario))
    except BadMessageError:
        return None
    before = 0.0 if scenario.ins.gives_solution else 1.0 / scenario.imu.rate
    sample = moved(sample, first - from_seconds(before))
    latitude, longitude, height = sample.position
    return {
        "start_position": [math.degrees(latitude), math.degrees(longitude), float(height)],
        "start_velocity": [float(speed) for speed in sample.velocity],
        "start_attitude": [math.degrees(angle) for angle in to_angles(sample.attitude)],
    }


TICK = 5.0
"""s between looks at the nodes' timers."""


class Player:
    """Nodes on a bus, what is still to be played to them, and what they have said. Its bus has to
    be closed.

    Parameters
    ----------
    recorded : Recorded
        What is played.
    own : mapping
        Own parameters of every node beside those of a replay.
    of_filter : mapping
        Own parameters of the filter's node.
    quiet : bool
        Whether the nodes' warnings and errors are not printed.

    Raises
    ------
    InputError
        A parameter, or the scenario, cannot be used.
    """

    def __init__(
        self,
        recorded: Recorded,
        own: Mapping[str, JsonValue],
        of_filter: Mapping[str, JsonValue],
        quiet: bool = True,
    ) -> None:
        self.recorded, self.bus = recorded, Bus(quiet)
        self.collector = Collector(recorded.scenario)
        self.collector.truth = recorded.collector.truth
        self.collector.unaided = recorded.collector.unaided
        self.reports: list[tuple[float, str]] = []
        """When (s) something was reported at WARN or ERROR, and what."""
        for topic in self.collector.topics():
            if topic not in (topics.TRUTH_FIX, topics.INS_FIX):
                self.bus.hear(topic, partial(self._take, topic))
        self._plan = Plan(recorded.scenario, None, run=recorded.run, real=True)
        names = [
            name
            for name in self._plan.names
            if recorded.reduces or topics.kind_of(name) != topics.GRAVIMETER
        ]
        self._own: dict[str, JsonValue] = {"peers": [*names], **own}
        self._of_filter = of_filter
        self.nodes: dict[str, GraphNode] = {}
        """By name."""
        self._due = deque(recorded.in_order())
        fed = [topic for topic, messages in recorded.sensors.items() if messages]
        self._publish = {topic: self.bus.source(topic) for topic in fed}
        self._ticked = 0.0
        try:
            for name in names:
                self.start(name)
            self.bus.tick()
        except BaseException:
            self.bus.close()
            raise

    def _take(self, topic: Topic, data: bytes) -> None:
        """Keep a serialised message that a node has published."""
        known = len(self.collector.said)
        self.collector.take(topic, data)
        new = self.collector.said[known:]
        self.reports += [(self.bus.now, f"{one.source}: {one.text}") for one in new]

    def start(self, name: str, without: Collection[str] = ()) -> None:
        """Make a node and let it begin, without some of its own parameters."""
        own = {key: value for key, value in self._own.items() if key not in without}
        if name == topics.UKF_FUSION:
            # one that begins later must not take the start for the state of its first sample
            own |= {"start_time": math.nan if self.bus.now == 0.0 else 0.0, **self._of_filter}
        self.nodes[name] = self.bus.add(name, self._plan.values(name) | own)

    @property
    def filter(self) -> InertialNavigator | None:
        """The filter, with its history; None = it has not begun."""
        return self.nodes[topics.UKF_FUSION].navigator

    def kill(self, name: str) -> None:
        """Take a node off, as if its process had been killed."""
        self.nodes.pop(name).destroy_node()

    def steps(self, until: float = math.inf) -> Iterator[int]:
        """Yield the stamp (ns) of each IMU sample up to a time (s), and then play what the sensors
        say up to it, and let the nodes deal with it."""
        for ns in [ns for ns, topic, _ in self._due if topic is self.recorded.inertial]:
            if to_seconds(ns) > until:
                break
            yield ns
            self.bus.now = to_seconds(ns)
            while self._due and self._due[0][0] <= ns:
                _, topic, data = self._due.popleft()
                self._publish[topic](data)
                self.bus.run()
            if self.bus.now >= self._ticked + TICK:
                self._ticked = self.bus.now
                self.bus.tick()

    def play(self, until: float = math.inf) -> "Player":
        """Play what is still to be played up to a time (s); return itself."""
        for _ in self.steps(until):
            pass
        return self
