"""One trial: a recording played to a fresh filter and matcher, with one fault in it."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

from isogal.earth.frames import horizontal_difference
from isogal.seeds import generator
from isogal_ros import topics
from isogal_ros.bags.collect import Collector
from isogal_ros.bags.reader import BagReader
from isogal_ros.faults.catalogue import SECOND, Fault, Moment, topic_of
from isogal_ros.graph.replay import replay
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.position import read_position
from isogal_ros.messages.stamps import peek_ns, to_seconds
from isogal_ros.nodes.signals import Interrupt
from isogal_ros.topics import Topic

STALL = 0.5
"""s of wall time that a step of a trial may take: a fault may leave it without an answer."""

EARLIER = 15 * SECOND
"""ns that diagnostics may be stamped before what they tell of: with the last data that could be
used."""


class Tampering:
    """A fault within a time, applied to recorded messages.

    Parameters
    ----------
    fault : Fault, optional
        None = the recording as it is.
    begin : float
        s.
    rng : Generator
    raw : Topic
        Of the readings.
    """

    patience = STALL

    def __init__(
        self, fault: Fault | None, begin: float, rng: np.random.Generator, raw: Topic
    ) -> None:
        self.fault = fault
        self.begin = round(begin * SECOND)
        self.end = self.begin if fault is None else self.begin + round(fault.lasts * SECOND)
        self._topic = None if fault is None else topic_of(fault, raw)
        self._moment = Moment(0.0, rng, {})

    def __call__(self, topic: Topic, data: bytes) -> list[bytes]:
        """Return what comes instead of a serialised message."""
        ns = peek_ns(data)
        if self.fault is None or topic is not self._topic or not self.begin <= ns < self.end:
            return [data]
        self._moment.since = to_seconds(ns - self.begin)
        changed = self.fault.change(deserialize_message(data, topic.type), self._moment)
        return [serialize_message(message) for message in changed]


@dataclass(frozen=True)
class Outcome:
    """What became of the navigator."""

    fault: str
    trial: int
    begin: float
    """s."""
    crash: str | None
    """What ended a node; None = nothing did."""
    not_finite: int
    """Messages on nav/fix that are not finite."""
    told_after: float | None
    """s until the diagnostics said WARN or ERROR; None = they did not."""
    told: str | None
    """With which words."""
    error_during: float
    """m, largest, from the fault's begin to its end."""
    error_after: float
    """m, RMS over the last third of the run."""
    sigma_after: float
    """m, RMS 1-sigma that the navigator gives itself then."""
    samples: int
    """States published."""
    restart: float | None = None
    """s of wall time that a faulty process said nothing."""
    lost: int = 0
    """Messages of a stamp that the run without fault has: truth, state, reading, fix."""

    def document(self) -> dict[str, Any]:
        """Return it as JSON can say it."""
        return {
            name: None if isinstance(value, float) and not np.isfinite(value) else value
            for name, value in self.__dict__.items()
        }


@dataclass
class _Track:
    time: np.ndarray = field(default_factory=lambda: np.zeros(0))
    error: np.ndarray = field(default_factory=lambda: np.zeros(0))
    sigma: np.ndarray = field(default_factory=lambda: np.zeros(0))
    not_finite: int = 0


def run_trial(reader: BagReader, fault: Fault | None, seed: int, trial: int) -> Outcome:
    """Play a recording with a fault at a time that is drawn from seed, trial and fault."""
    scenario = reader.scenario()
    assert scenario is not None
    name = "none" if fault is None else fault.name
    rng = generator(seed, trial, f"fault: {name}")
    duration = scenario.route.duration or 0.0
    begin = float(np.floor(rng.uniform(0.25, 0.45) * duration))
    tampering = Tampering(fault, begin, rng, adapter_of(scenario).raw)
    crash, collector, told = None, None, None
    try:
        result = replay(reader, Interrupt(), lambda progress: None, tamper=tampering)
        collector = result.outputs
        told = first_warning(collector, tampering.begin)
    except Exception as error:
        crash = f"{type(error).__name__}: {error}"
    span = begin, to_seconds(tampering.end) + 1.0
    return outcome_of(name, trial, span, crash, told, collector)


def first_warning(collector: Collector, begin_ns: int) -> tuple[int, str] | None:
    """Return stamp and words of the first diagnostics at WARN or ERROR from a time (ns) on."""
    later = (item for item in collector.warnings if item[0] >= begin_ns - EARLIER)
    return next(later, None)


def outcome_of(
    name: str,
    trial: int,
    span: tuple[float, float],
    crash: str | None,
    told: tuple[int, str] | None,
    collector: Collector | None,
    restart: float | None = None,
    lost: int = 0,
) -> Outcome:
    """Return the outcome of a run (None = there is none) with a fault from one time (s) to
    another that was told at a stamp with some words."""
    track = _Track() if collector is None else _track(collector)
    begin, end = span
    during = track.error[(track.time >= begin) & (track.time <= end)]
    end_ns = 0 if collector is None else max(collector.truth, default=0)
    last = track.time > 2.0 / 3.0 * to_seconds(end_ns)
    return Outcome(
        name,
        trial,
        begin,
        crash,
        track.not_finite,
        None if told is None else max(to_seconds(told[0]) - begin, 0.0),
        None if told is None else told[1],
        float(during.max(initial=0.0)),
        _rms(track.error[last]),
        _rms(track.sigma[last]),
        len(track.time),
        restart,
        lost,
    )


def _track(collector: Collector) -> _Track:
    """Return the navigator's error against the recorded truth."""
    rows, bad = [], 0
    for ns in sorted(collector.last_nav.keys() & collector.truth.keys()):
        fix = deserialize_message(collector.last_nav[ns], topics.NAV_FIX.type)
        if not np.isfinite([fix.latitude, fix.longitude, *fix.position_covariance]).all():
            bad += 1
            continue
        truth = deserialize_message(collector.truth[ns], topics.TRUTH_FIX.type)
        off = horizontal_difference(*read_position(fix)[:2], *read_position(truth)[:2])
        sigma = np.sqrt(fix.position_covariance[0] + fix.position_covariance[4])
        rows.append((to_seconds(ns), float(np.hypot(*off)), float(sigma)))
    if not rows:
        return _Track(not_finite=bad)
    time, error, sigma = np.array(rows).T
    return _Track(time, error, sigma, bad)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")
