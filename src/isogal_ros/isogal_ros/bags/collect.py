"""The messages of a run, by stamp, that its record is made of: of a bag, also while it is
written."""

import struct
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import NavSatStatus

from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader, topic_of
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.position import read_position
from isogal_ros.messages.prepared import Reader
from isogal_ros.messages.stamps import from_seconds, peek_ns, to_ns
from isogal_ros.nodes.health import figures_of
from isogal_ros.topics import Topic

LEVELS = {
    DiagnosticStatus.WARN: "WARN",
    DiagnosticStatus.ERROR: "ERROR",
    DiagnosticStatus.STALE: "STALE",
}


class Said(NamedTuple):
    """Something that a node said of itself."""

    ns: int
    """Stamp."""
    level: str
    name: str
    text: str


class Collector:
    """Keeps messages serialised, as most of them are never decoded.

    Parameters
    ----------
    scenario : Scenario
        What was run.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.first_nav: dict[int, bytes] = {}
        """nav/fix by stamp, before a fix of that stamp."""
        self.last_nav: dict[int, bytes] = {}
        """nav/fix by stamp, after it."""
        self.truth: dict[int, bytes] = {}
        self.unaided: dict[int, bytes] = {}
        self.readings: dict[int, bytes] = {}
        """Reduced readings by stamp; of several fields those of the first."""
        self.others: tuple[dict[int, bytes], ...] = ()
        """Those of each of the others."""
        self.fixes: dict[int, bytes] = {}
        self.candidates: dict[int, bytes] = {}
        self.batches: dict[int, dict[str, str]] = {}
        """Figures of each batch by stamp of its end, from the diagnostics."""
        self.aids: list[Said] = []
        """What the navigator said of each aid; its level is OK where it was used."""
        self.said: list[Said] = []
        """Diagnostics that are not OK."""
        self.namespace: str | None = None
        """Of the nodes whose diagnostics are kept; None = of all."""
        first, *others = scenario.each_field
        self.others = tuple({} for _ in others)
        self._plain: dict[Topic, dict[int, bytes]] = {
            topics.TRUTH_FIX: self.truth,
            topics.INS_FIX: self.unaided,
            topics.FIX: self.fixes,
            topics.CANDIDATES: self.candidates,
            adapter_of(first).reduced: self.readings,
        }
        for one, readings in zip(others, self.others, strict=True):
            self._plain[adapter_of(one).reduced] = readings

    def topics(self) -> tuple[Topic, ...]:
        """Return the topics that are wanted."""
        return (*self._plain, topics.NAV_FIX, topics.NAV_AIDS, topics.DIAGNOSTICS)

    def take(self, topic: Topic, data: bytes) -> None:
        """Keep one serialised message, if its topic is wanted."""
        if topic in self._plain:
            self._plain[topic][peek_ns(data)] = data
        elif topic is topics.NAV_FIX:
            ns = peek_ns(data)
            self.first_nav.setdefault(ns, data)
            self.last_nav[ns] = data
        elif topic is topics.NAV_AIDS:
            array = deserialize_message(data, topics.NAV_AIDS.type)
            ns = to_ns(array.header.stamp)
            self.aids += [
                Said(ns, LEVELS.get(item.level, "OK"), item.name, item.message)
                for item in array.status
                if not item.name.endswith(topics.NAVIGATOR)
            ]
        elif topic is topics.DIAGNOSTICS:
            self._take_diagnostics(data)

    def take_bag(self, reader: BagReader) -> None:
        """Keep what a bag holds; of other graphs' diagnostics in it, nothing."""
        self.namespace = reader.texts.get("namespace")
        for topic, data in wanted_messages(reader, self.topics()):
            self.take(topic, data)

    @property
    def warnings(self) -> list[tuple[int, str]]:
        """Stamps and words of diagnostics at WARN or ERROR."""
        return [(one.ns, f"{one.name}: {one.text}") for one in self.said]

    def fix_positions(self) -> dict[int, tuple[float, float] | None]:
        """Return latitude and longitude (rad) of each batch's fix by stamp; None where the batch
        gave none."""
        result: dict[int, tuple[float, float] | None] = {}
        for ns, data in self.fixes.items():
            message = deserialize_message(data, topics.FIX.type)
            if message.status.status == NavSatStatus.STATUS_NO_FIX:
                result[ns] = None
            else:
                latitude, longitude, _ = read_position(message)
                result[ns] = latitude, longitude
        return result

    def _take_diagnostics(self, data: bytes) -> None:
        if _one_that_is_ok(data):
            return
        array = deserialize_message(data, topics.DIAGNOSTICS.type)
        for item in array.status:
            if self.namespace not in (None, item.name.rpartition("/")[0]):
                continue
            if item.level != DiagnosticStatus.OK:
                level = LEVELS.get(item.level, "ERROR")
                self.said.append(Said(to_ns(array.header.stamp), level, item.name, item.message))
            if item.name.endswith(f"{topics.PMHT_MM}: batch"):
                figures = figures_of(item) | {"message": item.message}
                self.batches[from_seconds(float(figures["stamp"]))] = figures


def _one_that_is_ok(data: bytes) -> bool:
    """Whether serialised diagnostics are of one status, which is OK, as nearly all are: decoding
    each takes longer than all else of a recording."""
    content = Reader(data)
    try:
        content.take("iI")  # the stamp
        content.text()
        (count,) = content.take("I")
        (level,) = content.take("B")
    except (struct.error, UnicodeDecodeError):
        return False
    return bool(count == 1 and bytes([int(level)]) == DiagnosticStatus.OK)


def wanted_messages(
    reader: BagReader, wanted: Sequence[Topic], new: bool = False
) -> Iterator[tuple[Topic, bytes]]:
    """Yield topic and serialised message of a bag, of the topics that are wanted, in whatever
    namespace they were recorded, as the graph has them; of a bag that is being written, only what
    is new since the last time if that is asked for."""
    found: dict[str, Topic | None] = {}
    for message in reader.new_messages() if new else reader.messages():
        name = message.topic
        if name not in found:
            found[name] = next((topic for topic in wanted if topic_of(name, topic.name)), None)
        topic = found[name]
        if topic is not None:
            kind = reader.types[name]
            with suppress(BadMessageError):  # of a driver that says nothing that can be used
                data = reader.entrance.take_serialised(topic, message.data, kind, message.log_ns)
                yield topic, data
