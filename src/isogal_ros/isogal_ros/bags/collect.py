"""From the graph's messages to the record of a run that the evaluation works on."""

from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import NavSatStatus

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.records import RunDetail, Runs
from isogal.maps.channels import AnyMap, channels_of
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Candidates
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader, topic_of
from isogal_ros.messages.convert import read_candidates, read_covariance, read_position
from isogal_ros.messages.readings import adapter_of
from isogal_ros.messages.stamps import from_seconds, peek_ns, to_seconds
from isogal_ros.nodes.health import BadMessageError, figures_of
from isogal_ros.topics import Topic


class Collector:
    """Keeps serialised messages by stamp and decodes those that a record needs: at the start and
    at every scan.

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
        self.fixes: dict[int, bytes] = {}
        self.candidates: dict[int, bytes] = {}
        self.batches: dict[int, dict[str, str]] = {}
        """Figures of each batch by stamp of its end, from the diagnostics."""
        self._plain: dict[str, dict[int, bytes]] = {
            topics.TRUTH_FIX.name: self.truth,
            topics.INS_FIX.name: self.unaided,
            topics.readings(scenario.measured_field).name: self.readings,
            topics.FIX.name: self.fixes,
            topics.CANDIDATES.name: self.candidates,
        }

    def topics(self) -> tuple[Topic, ...]:
        """Return the topics that are wanted."""
        wanted = {*self._plain, topics.NAV_FIX.name, topics.DIAGNOSTICS.name}
        return tuple(topic for topic in topics.ALL if topic.name in wanted)

    def take(self, topic: Topic, data: bytes) -> None:
        """Keep one serialised message."""
        if topic.name in self._plain:
            self._plain[topic.name][peek_ns(data)] = data
        elif topic is topics.NAV_FIX:
            ns = peek_ns(data)
            self.first_nav.setdefault(ns, data)
            self.last_nav[ns] = data
        elif topic is topics.DIAGNOSTICS:
            for item in deserialize_message(data, topics.DIAGNOSTICS.type).status:
                if item.name.endswith(f"{topics.PMHT_MM}: batch"):
                    figures = figures_of(item)
                    self.batches[from_seconds(float(figures["stamp"]))] = {
                        **figures,
                        "message": item.message,
                    }

    def take_bag(self, reader: BagReader) -> None:
        """Keep what a bag holds."""
        wanted = self.topics()
        found: dict[str, Topic | None] = {}
        for message in reader.messages():
            if message.topic not in found:
                found[message.topic] = next(
                    (topic for topic in wanted if topic_of(message.topic, topic.name)), None
                )
            topic = found[message.topic]
            if topic is not None:
                self.take(topic, message.data)

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

    def runs(self, field_map: AnyMap) -> Runs | None:
        """Return the record of the run; None where truth or navigation is missing, or no scan is
        covered by both."""
        scans = sorted(ns for ns in self.readings if ns in self.truth and ns in self.last_nav)
        starts = sorted(ns for ns in self.last_nav if ns in self.truth)
        if not scans:
            return None
        stamps = ([starts[0]] if starts[0] < scans[0] else []) + scans
        truth = self._positions(self.truth, stamps)
        nav = self._positions(self.last_nav, stamps)
        unaided = self._positions(self.unaided, stamps)
        covariance = np.stack([self._covariance(self.last_nav[ns]) for ns in stamps])
        # retrodiction publishes a fix for each scan: only the batch ends have figures in the
        # diagnostics
        batch_ends = self.batches if self.scenario.matcher.mode == "retrodiction" else self.fixes
        ends = sorted(
            ns
            for ns in batch_ends
            if ns in self.fixes and ns in self.truth and ns in self.last_nav
        )
        error = horizontal_difference(nav[:, 0], nav[:, 1], truth[:, 0], truth[:, 1])
        return Runs(
            time=np.array([to_seconds(ns) for ns in stamps]),
            latitude=truth[:, 0],
            longitude=truth[:, 1],
            error=error[None],
            covariance=covariance[None],
            unaided_error=horizontal_difference(
                unaided[:, 0], unaided[:, 1], truth[:, 0], truth[:, 1]
            )[None],
            **self._fix_record(ends),
            detail=self._detail(scans, ends, channels_of(field_map)[0]),
        )

    def _fix_record(self, ends: list[int]) -> dict[str, Any]:
        error, covariance = np.full((len(ends), 2), np.nan), np.full((len(ends), 2, 2), np.nan)
        posterior, posterior_covariance = (
            np.full((len(ends), 2), np.nan),
            np.full((len(ends), 2, 2), np.nan),
        )
        reasons: list[str | None] = []
        seconds = np.full(len(ends), np.nan)
        for i, ns in enumerate(ends):
            latitude, longitude = _position(self.truth[ns])
            message = deserialize_message(self.fixes[ns], topics.FIX.type)
            figures = self.batches.get(ns, {})
            seconds[i] = float(figures.get("seconds", "nan"))
            if message.status.status == NavSatStatus.STATUS_NO_FIX:
                reasons.append(figures.get("message") or "not said")
            else:
                reasons.append(None)
                found = read_position(message)
                error[i] = horizontal_difference(found[0], found[1], latitude, longitude)
                covariance[i] = read_covariance(message)[:2, :2]
            posterior[i] = horizontal_difference(
                *_position(self.last_nav[ns]), latitude, longitude
            )
            posterior_covariance[i] = self._covariance(self.last_nav[ns])
        return {
            "fix_time": np.array([to_seconds(ns) for ns in ends]),
            "fix_error": error[None],
            "fix_covariance": covariance[None],
            "fix_reason": (tuple(reasons),),
            "posterior_error": posterior[None],
            "posterior_covariance": posterior_covariance[None],
            "fix_seconds": seconds[None],
        }

    def _detail(self, scans: list[int], ends: list[int], field_map: FieldMap) -> RunDetail:
        truth, seen = self._positions(self.truth, scans), self._positions(self.first_nav, scans)
        variability = np.full(len(scans), np.nan)
        for i, ns in enumerate(scans):
            variability[i] = float(self.batches.get(ns, {}).get("feature_variability", "nan"))
        return RunDetail(
            scan_time=np.array([to_seconds(ns) for ns in scans]),
            reading=np.array([self._reading(self.readings[ns]) for ns in scans]),
            map_value=field_map.value(truth[:, 0], truth[:, 1]),
            map_value_navigator=field_map.value(seen[:, 0], seen[:, 1]),
            feature_variability=variability,
            **RunDetail.flatten([self._candidates(ns) for ns in ends]),
        )

    def _candidates(self, ns: int) -> Candidates | None:
        data = self.candidates.get(ns)
        found = (
            None
            if data is None
            else read_candidates(deserialize_message(data, topics.CANDIDATES.type))
        )
        return found if found is not None and len(found.latitude) else None

    def _reading(self, data: bytes) -> float:
        adapter = adapter_of(self.scenario)
        try:
            value, _ = adapter.read_reduced(deserialize_message(data, adapter.reduced.type))
            return float(np.ravel(value)[0])  # figures show the first channel
        except BadMessageError:
            return float("nan")

    @staticmethod
    def _positions(store: dict[int, bytes], stamps: list[int]) -> Array:
        nothing = (np.nan, np.nan)
        return np.array([_position(store[ns]) if ns in store else nothing for ns in stamps])

    @staticmethod
    def _covariance(data: bytes) -> Array:
        return read_covariance(deserialize_message(data, topics.NAV_FIX.type))[:2, :2]


def _position(data: bytes) -> tuple[float, float]:
    latitude, longitude, _ = read_position(
        deserialize_message(data, topics.NAV_FIX.type), frame=""
    )
    return latitude, longitude
