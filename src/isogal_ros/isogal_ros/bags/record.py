"""The messages of a run, by stamp, and the record that the evaluation works on, which is made of
them: of a bag, also while it is written."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import NavSatStatus

from isogal.arrays import Array
from isogal.cli.errors import note
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.records import RunDetail, Runs
from isogal.evaluation.view.record import Event
from isogal.fix import Candidates, Fix, Status
from isogal.maps.channels import channels_of
from isogal.maps.several import RunMap, first_map
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader, topic_of
from isogal_ros.messages.adapter import Adapter, adapter_of
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.drivers import type_taken
from isogal_ros.messages.fix_information import read_fix
from isogal_ros.messages.point import read_candidates
from isogal_ros.messages.position import read_covariance, read_place
from isogal_ros.messages.prepared import decoded, peek_ns
from isogal_ros.messages.stamps import from_seconds, to_ns, to_seconds
from isogal_ros.nodes.health import figures_of
from isogal_ros.topics import Topic, type_name

LEVELS = {
    DiagnosticStatus.OK: "OK",
    DiagnosticStatus.WARN: "WARN",
    DiagnosticStatus.ERROR: "ERROR",
    DiagnosticStatus.STALE: "STALE",
}


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
        self.aids: list[Event] = []
        """What the navigator said of each aid; its level is OK where it was used."""
        self.said: list[Event] = []
        """Diagnostics that are not OK."""
        self.namespace: str | None = None
        """Of the nodes whose diagnostics are kept; None = of all."""
        first, *others = (adapter_of(one).reduced for one in scenario.each_field)
        self.others = tuple({} for _ in others)
        self._plain: dict[Topic, dict[int, bytes]] = {
            topics.TRUTH_FIX: self.truth,
            topics.INS_FIX: self.unaided,
            topics.FIX: self.fixes,
            topics.CANDIDATES: self.candidates,
            first: self.readings,
            **dict(zip(others, self.others, strict=True)),
        }

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
            self.aids += [
                one for one in _events(array) if not one.source.endswith(topics.NAVIGATOR)
            ]
        elif topic is topics.DIAGNOSTICS:
            array = deserialize_message(data, topics.DIAGNOSTICS.type)
            for item, event in zip(array.status, _events(array), strict=True):
                if self.namespace not in (None, item.name.rpartition("/")[0]):
                    continue
                if event.level != "OK":
                    self.said.append(event)
                if item.name.endswith(f"{topics.PMHT_MM}: batch"):
                    figures = figures_of(item) | {"message": item.message}
                    self.batches[from_seconds(float(figures["stamp"]))] = figures

    def take_bag(self, reader: BagReader) -> None:
        """Keep what a bag holds; of other graphs' diagnostics in it, nothing."""
        self.namespace = reader.texts.get("namespace")
        for topic, data in wanted_messages(reader, self.topics()):
            self.take(topic, data)

    def fix_positions(self) -> dict[int, tuple[float, float] | None]:
        """Return latitude and longitude (rad) of each batch's fix by stamp; None where the batch
        gave none."""
        each = {ns: self.fix(ns) for ns in self.fixes}
        return {ns: (x.latitude, x.longitude) if x.published else None for ns, x in each.items()}

    def fix(self, ns: int) -> Fix:
        """Return the fix of a stamp."""
        return read_fix(deserialize_message(self.fixes[ns], topics.FIX.type)).fix


def _events(array: DiagnosticArray) -> list[Event]:
    """Return what diagnostics say."""
    time = to_seconds(to_ns(array.header.stamp))
    return [
        Event(time, LEVELS.get(item.level, "ERROR"), item.name, item.message)
        for item in array.status
    ]


def wanted_messages(
    reader: BagReader, wanted: Sequence[Topic], new: bool = False
) -> Iterator[tuple[Topic, bytes]]:
    """Yield topic and serialised message of a bag, of the topics that are wanted, in whatever
    namespace they were recorded, as the graph has them; of a bag that is being written, only what
    is new since the last time if that is asked for. What is of another type, cut off, or a
    position of no place on the Earth, as of a receiver without satellites, is left out, and that
    is said."""
    found: dict[str, Topic | None] = {}
    left_out: dict[str, list[str]] = {}
    for message in reader.new_messages() if new else reader.messages():
        name = message.topic
        if name not in found:
            topic = next((topic for topic in wanted if topic_of(name, topic.name)), None)
            if topic is not None and type_taken(topic, (reader.types[name],)) is None:
                note(
                    f"{name} is left out: it is {reader.types[name]}, not {type_name(topic.type)}"
                )
                topic = None
            found[name] = topic
        topic = found[name]
        if topic is not None:
            kind = reader.types[name]
            try:
                data = reader.entrance.take_serialised(topic, message.data, kind, message.log_ns)
                _require_whole(topic, data)
            except BadMessageError as error:
                left_out.setdefault(name, []).append(str(error))
                continue
            yield topic, data
    for name, why in () if new else left_out.items():
        note(f"{reader.path}: messages left out of {name}: {len(why)} ({why[-1]})")


_PLACES = topics.NAV_FIX, topics.TRUTH_FIX, topics.INS_FIX


def _require_whole(topic: Topic, data: bytes) -> None:
    """Raise BadMessageError unless a serialised message can be read, and a position is of a
    place."""
    message = decoded(data, topic.type)
    if topic in _PLACES:
        place = read_place(message)
        if message.status.status == NavSatStatus.STATUS_NO_FIX and place == (0.0, 0.0):
            raise BadMessageError("no fix, and therefore no position")


LONGEST_GAP = 10_000_000_000
"""ns between two messages, between which a position is not guessed any more."""


class Places:
    """Positions of serialised NavSatFix messages of any frame, by stamp (ns), and between the
    stamps: real sensors do not sample at the same times."""

    def __init__(self, messages: dict[int, bytes]) -> None:
        self._messages, self._stamps = messages, sorted(messages)

    def __contains__(self, ns: int) -> bool:
        return bool(self._around(ns))

    def at(self, stamps: Sequence[int]) -> Array:
        """Return latitude and longitude (rad) (n, 2) at stamps, linear between messages; NaN where
        there is none on either side."""
        found = np.full((len(stamps), 2), np.nan)
        for row, ns in zip(found, stamps, strict=True):
            if around := self._around(ns):
                places = [self._position(stamp) for stamp in around]
                # also across 180 degrees
                row[:] = [np.interp(ns, around, np.unwrap(one)) for one in np.transpose(places)]
        return found

    def before(self, ns: int) -> bytes:
        """Return the message of a stamp, or the last one before it."""
        return self._messages[self._stamps[bisect_right(self._stamps, ns) - 1]]

    def _around(self, ns: int) -> list[int]:
        """Return the stamps before and after one, or itself; none where they are too far apart."""
        if ns in self._messages:
            return [ns]
        i = bisect_right(self._stamps, ns)
        both = self._stamps[i - 1 : i + 1] if i > 0 else []
        return both if len(both) == 2 and both[1] - both[0] <= LONGEST_GAP else []

    def _position(self, ns: int) -> tuple[float, float]:
        message = deserialize_message(self._messages[ns], topics.NAV_FIX.type)
        return read_place(message)


def gaps(collector: Collector) -> list[list[float]]:
    """Return from when to when (s) nothing was recorded: not even the truth, which comes at one
    rate whatever becomes of the other nodes."""
    stamps = np.array(sorted(collector.truth))
    if len(stamps) < 3:
        return []
    apart = np.diff(stamps)
    missing = np.flatnonzero(apart > 1.5 * np.median(apart))
    return [[to_seconds(stamps[i]), to_seconds(stamps[i + 1])] for i in missing.tolist()]


def record_of(collector: Collector, field_map: RunMap) -> Runs | None:
    """Return the record of the run; None where truth or navigation is missing, or no scan is
    covered by both. Without any readings each state stands for a scan."""
    truth, last_nav = Places(collector.truth), Places(collector.last_nav)
    first_nav, unaided = Places(collector.first_nav), Places(collector.unaided)
    scans = _known(_scans(collector), truth, last_nav)
    if not scans:
        return None
    start = next(ns for ns in sorted({*collector.last_nav, scans[0]}) if ns in truth)
    stamps = ([start] if start < scans[0] else []) + scans
    places, nav = truth.at(stamps), last_nav.at(stamps)
    retrodiction = collector.scenario.matcher.mode == "retrodiction"
    # which publishes a fix for each scan: only the batch ends have figures in the diagnostics
    batches = collector.batches.keys() if retrodiction else collector.fixes.keys()
    ends = _known(batches & collector.fixes.keys(), truth, last_nav)
    fixes = [collector.fix(ns) for ns in ends]
    said = [collector.batches.get(ns, {}) for ns in ends]
    outcomes = [_outcome(*both) for both in zip(fixes, said, strict=True)]
    published = np.array([fix.published for fix in fixes], dtype=bool)
    fix_places = np.array([[fix.latitude, fix.longitude] for fix in fixes]).reshape(-1, 2)
    fix_error = horizontal_difference(*fix_places.T, *truth.at(ends).T)
    fix_covariance = np.array([fix.covariance for fix in fixes]).reshape(-1, 2, 2)
    readings = [ns for ns in scans if ns in collector.readings]
    field = channels_of(first_map(field_map))[0]
    adapter = adapter_of(collector.scenario.each_field[0])
    return Runs(
        time=np.array([to_seconds(ns) for ns in stamps]),
        latitude=places[:, 0],
        longitude=places[:, 1],
        error=horizontal_difference(*nav.T, *places.T)[None],
        covariance=_covariances(last_nav, stamps),
        unaided_error=horizontal_difference(*unaided.at(stamps).T, *places.T)[None],
        fix_time=np.array([to_seconds(ns) for ns in ends]),
        fix_error=np.where(published[:, None], fix_error, np.nan)[None],
        fix_covariance=np.where(published[:, None, None], fix_covariance, np.nan)[None],
        fix_status=np.array([[status for status, _ in outcomes]], dtype=np.str_),
        fix_reason=np.array([[reason for _, reason in outcomes]], dtype=np.str_),
        posterior_error=horizontal_difference(*last_nav.at(ends).T, *truth.at(ends).T)[None],
        posterior_covariance=_covariances(last_nav, ends),
        fix_seconds=np.array([[float(one.get("seconds", "nan")) for one in said]]),
        detail=RunDetail(
            scan_time=np.array([to_seconds(ns) for ns in readings]),
            reading=np.array([_reading(adapter, collector.readings[ns]) for ns in readings]),
            map_value=field.value(*truth.at(readings).T),
            map_value_navigator=field.value(*first_nav.at(readings).T),
            **RunDetail.flatten([_candidates(collector.candidates.get(ns)) for ns in ends]),
        ),
    )


def _known(stamps: Iterable[int], *each: Places) -> list[int]:
    """Return the stamps, in order, at which all of some positions are known."""
    return sorted(ns for ns in stamps if all(ns in places for places in each))


def _scans(collector: Collector) -> Iterable[int]:
    """Return the stamps of scans; those of several fields have one schedule."""
    if not (collector.readings and collector.others):
        return collector.readings or collector.last_nav
    interval = from_seconds(collector.scenario.scan_interval)
    return (ns for ns in collector.truth if ns > 0 and ns % interval == 0)


def _outcome(fix: Fix, said: Mapping[str, str]) -> tuple[str, str]:
    """Return status and reason of a batch."""
    if fix.published:
        return Status.FIX.value, ""
    return said.get("status", Status.DECLINED.value), said.get("message") or "not said"


def _candidates(data: bytes | None) -> Candidates | None:
    if data is None:
        return None
    found = read_candidates(deserialize_message(data, topics.CANDIDATES.type))
    return found if len(found.latitude) else None


def _reading(adapter: Adapter, data: bytes) -> float:
    """Return a reading, or its first channel, which is what figures show."""
    try:
        value, _ = adapter.read_reduced(deserialize_message(data, adapter.reduced.type))
        return float(np.ravel(value)[0])
    except BadMessageError:
        return float("nan")


def _covariances(messages: Places, stamps: Sequence[int]) -> Array:
    """Return the horizontal covariances (1, n, 2, 2), m², of NavSatFix messages at stamps, or the
    last before them; NaN where they are not known."""
    found = np.full((1, len(stamps), 2, 2), np.nan)
    for row, ns in zip(found[0], stamps, strict=True):
        with suppress(BadMessageError):  # of another navigator's, or of a receiver's
            message = deserialize_message(messages.before(ns), topics.NAV_FIX.type)
            row[:] = read_covariance(message)[:2, :2]
    return found
