"""What became of the navigator under a fault."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message

from isogal.earth.frames import horizontal_difference
from isogal_ros import topics
from isogal_ros.bags.collect import Collector
from isogal_ros.messages.position import read_position
from isogal_ros.messages.stamps import to_seconds

EARLIER = 15.0
"""s that diagnostics may be stamped before what they tell of: with the last data that could be
used."""


@dataclass(frozen=True)
class Outcome:
    """What became of the navigator."""

    fault: str
    trial: int
    begin: float
    """s."""
    not_finite: int
    """Messages on nav/fix that are not finite."""
    told_after: float | None
    """s until the diagnostics said WARN or ERROR; None = they did not."""
    told: str | None
    """With which words."""
    error_during: float
    """m, largest, from the fault's begin to its end."""
    error_after: float
    """m, RMS in the time that is looked at after it."""
    sigma_after: float
    """m, RMS 1-sigma that the navigator gives itself then."""
    error_without: float
    """m, RMS then of the same run without the fault."""
    samples: int
    """States published."""
    crash: str | None = None
    """What ended a node, or that the trial hung; None = nothing did."""
    restart: float | None = None
    """s of wall time that a faulty process said nothing."""
    lost: int = 0
    """Messages of a stamp that the run without fault has: truth, state, reading, fix."""
    surprises: tuple[str, ...] = ()
    """What the nodes logged of messages that they did not foresee."""

    def document(self) -> dict[str, Any]:
        """Return it as JSON can say it."""
        return {
            name: None if isinstance(value, float) and not np.isfinite(value) else value
            for name, value in self.__dict__.items()
        }


def first_warning(collector: Collector, begin: float) -> tuple[float, str] | None:
    """Return time (s) and words of the first diagnostics at WARN or ERROR from a time (s) on."""
    for ns, text in collector.warnings:
        if to_seconds(ns) >= begin - EARLIER:
            return to_seconds(ns), text
    return None


@dataclass(frozen=True)
class Span:
    """When a fault was, and when it is looked at how it was recovered from, s."""

    begin: float
    end: float
    after: float
    until: float


def outcome_of(
    name: str,
    trial: int,
    span: Span,
    tracks: tuple["Track", "Track"],
    told: tuple[float, str] | None = None,
) -> Outcome:
    """Return the outcome of a run with a fault that was told at a time (s) with some words.

    Parameters
    ----------
    tracks : (Track, Track)
        With the fault, and without.
    """
    track, plain = tracks
    during = track.error[(track.time >= span.begin) & (track.time <= span.end)]
    after, without = ((one.time > span.after) & (one.time <= span.until) for one in (track, plain))
    return Outcome(
        name,
        trial,
        span.begin,
        track.not_finite,
        None if told is None else max(told[0] - span.begin, 0.0),
        None if told is None else told[1],
        float(during.max(initial=0.0)),
        _rms(track.error[after]),
        _rms(track.sigma[after]),
        _rms(plain.error[without]),
        len(track.time),
    )


@dataclass
class Track:
    """The navigator's horizontal error and 1-sigma (N,), m, at times (N,), s."""

    time: np.ndarray = field(default_factory=lambda: np.zeros(0))
    error: np.ndarray = field(default_factory=lambda: np.zeros(0))
    sigma: np.ndarray = field(default_factory=lambda: np.zeros(0))
    not_finite: int = 0
    """States that were not finite."""


def track_of(collector: Collector) -> Track:
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
        return Track(not_finite=bad)
    time, error, sigma = np.array(rows).T
    return Track(time, error, sigma, bad)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")
