"""Trials: a run without fault, and the same with one fault from a time on, played to fresh
nodes."""

import re
import signal
import tempfile
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import JsonValue
from rclpy.serialization import deserialize_message, serialize_message

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.scenario import Scenario
from isogal.seeds import generator
from isogal_ros import topics
from isogal_ros.bags.collect import Collector
from isogal_ros.bags.reader import BagReader
from isogal_ros.faults.catalogue import Fault, Moment, topics_of
from isogal_ros.graph.plan import Plan
from isogal_ros.graph.player import TICK, Player
from isogal_ros.graph.recorded import load
from isogal_ros.graph.running import run_in_process
from isogal_ros.messages.position import read_position
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.nodes.health import without_numbers
from isogal_ros.nodes.signals import Interrupt

LIMIT = 600.0
"""s of wall time after which a trial hangs: it takes a few, of a machine with twenty times as much
to do than it can a hundred or two."""
UNEXPECTED = re.compile(r": \w*(Error|Exception|Warning): ")
"""In what a node logs of an exception (`GraphNode.guard`)."""
RECOVERY, LOOKED_AT = 2.0 / 9.0, 1.0 / 6.0
"""Shares of a run's duration: after a fault it has so long to recover, and is looked at for so
long then."""
TURN = 20.0
"""s that a slow node takes nothing, and then goes."""
STORES = ("truth", "last_nav", "readings", "fixes")
"""Messages of a `Collector` that are lost where only the run without fault has their stamp."""


@dataclass(frozen=True)
class Outcome:
    """What became of the navigator in a run with a fault: a line of ``outcomes.jsonl``. Times in
    s, errors in m; None = not known, or it did not happen."""

    fault: str
    trial: int
    errors: list[str]
    """What ended a node, that the trial hung, and exceptions that were not foreseen."""
    not_finite: int
    """States that were not finite."""
    reported_after: float | None
    report: str | None
    error_during: float
    """The largest."""
    error_after: float | None
    """RMS, as the error of the run without fault."""
    error_without: float | None
    lost: int


class Track(NamedTuple):
    """The navigator's horizontal error and 1-sigma (N,), m, at times (N,), s."""

    time: Array
    error: Array
    sigma: Array
    not_finite: int

    def rms(self, begin: float, end: float) -> float | None:
        """Return the RMS error between two times (s); None where there is no state."""
        within = self.error[(self.time > begin) & (self.time <= end)]
        return float(np.sqrt(np.mean(within**2))) if within.size else None


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
    time, error, sigma = np.array(rows).reshape(-1, 3).T
    return Track(time, error, sigma, bad)


class Feed:
    """A run without fault, which is simulated: what its sensors measured, and what was answered.

    Parameters
    ----------
    scenario : Scenario
    run : int
        Index of the run.
    interrupt : Interrupt, optional
        Ends the simulation early.

    Raises
    ------
    InputError
        The scenario cannot be used.
    GraphError
        A node failed.
    KeyboardInterrupt
        The simulation was interrupted.
    """

    def __init__(self, scenario: Scenario, run: int, interrupt: Interrupt | None = None) -> None:
        self.scenario, self.run = scenario, run
        interrupt = Interrupt() if interrupt is None else interrupt
        with tempfile.TemporaryDirectory() as folder:
            bag = Path(folder) / "bag"
            run_in_process(Plan(scenario, bag, run=run), interrupt)
            if interrupt:
                raise KeyboardInterrupt
            self.recorded = load(BagReader(bag), scenario, changed=True)
        self.collector = self.recorded.collector
        self.track = track_of(self.collector)
        self.duration = to_seconds(max(self.collector.truth))
        """s."""
        self.reports = {without_numbers(text) for _, text in self.collector.warnings}
        """What was reported at WARN or ERROR, without its numbers."""

    def player(self, checkpoints: Path | None = None) -> Player:
        """Return fresh nodes that the run is played to; they write checkpoints into a folder, if
        there is one."""
        own: dict[str, JsonValue] = {"diagnostics_period": 2.0 * TICK}
        if checkpoints is not None:
            own["checkpoint"] = str(checkpoints)
        return Player(replace(self.recorded, scenario=self.scenario), own, {})


@contextmanager
def _limited() -> Iterator[None]:
    """Raise SystemExit, which no node takes for what is wrong with a message, where the block
    lasts for `LIMIT`; in the main thread."""

    def end(*_: object) -> None:
        raise SystemExit(f"nothing came within {LIMIT:g} s")

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, LIMIT)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def run_trial(feed: Feed, fault: Fault) -> Outcome:
    """Play a run with a fault, which begins at a time drawn from seed, run and its name, and
    return what became of it."""
    rng = generator(feed.scenario.seed, feed.run, f"fault: {fault.name}")
    begin = float(np.floor(rng.uniform(0.25, 0.45) * feed.duration))
    after = begin + fault.lasts + 1.0 + RECOVERY * feed.duration
    until = after + LOOKED_AT * feed.duration
    errors: list[str] = []
    with tempfile.TemporaryDirectory(prefix="isogal-faults-") as folder:
        # checkpoints take time, and only nodes that are killed need them
        player = feed.player(Path(folder) if isinstance(fault.effect, str) else None)
        with player.bus:
            player.play(begin - 1e-9)
            known = len(player.reports)
            try:
                with _limited():
                    _play(player, fault, begin, until, rng)
            except (Exception, SystemExit):
                errors.append(traceback.format_exc(limit=-3))
    track = track_of(player.collector)
    during = track.error[(track.time >= begin) & (track.time <= begin + fault.lasts + 1.0)]
    new = (one for one in player.reports[known:] if without_numbers(one[1]) not in feed.reports)
    first, text = next(new, (None, None))
    errors += [without_numbers(one) for one in player.bus.errors if UNEXPECTED.search(one)]
    lost = [
        ns
        for name in STORES
        for ns in getattr(feed.collector, name).keys() - getattr(player.collector, name).keys()
    ]
    return Outcome(
        fault.name,
        feed.run,
        list(dict.fromkeys(errors)),
        track.not_finite,
        None if first is None else max(first - begin, 0.0),
        text,
        float(during.max(initial=0.0)),
        track.rms(after, until),
        feed.track.rms(after, until),
        sum(to_seconds(ns) <= until for ns in lost),
    )


def _play(
    player: Player, fault: Fault, begin: float, until: float, rng: np.random.Generator
) -> None:
    """Play a run from where a player is, with a fault that begins now (s), up to a time (s)."""
    of_source = topics_of(fault.targets[0], player.recorded.readings)
    types = {topic.name: topic.type for topic in of_source}
    moments: dict[str, Moment] = {}

    def change(topic: str, data: bytes) -> list[bytes]:
        """Return what comes instead of a serialised message."""
        effect, since = fault.effect, player.bus.now - begin
        if isinstance(effect, str) or topic not in types or not fault.is_on(since):
            return [data]
        moment = moments.setdefault(topic, Moment(rng))
        moment.since = since
        moment.came.append(deserialize_message(data, types[topic]))
        return [
            serialize_message(one)
            for one in effect(deserialize_message(data, types[topic]), moment)
        ]

    acts, player.bus.change = False, change
    for ns in player.steps(until):
        is_on = fault.is_on(to_seconds(ns) - begin, TURN)
        if isinstance(fault.effect, str) and acts != is_on:
            acts = is_on
            for name in fault.targets:
                _act(player, fault.effect, name, acts)


def _act(player: Player, effect: str, name: str, begins: bool) -> None:
    """Let a fault of a node begin or end."""
    if effect not in ("killed", "begun anew"):
        (player.bus.stop if begins else player.bus.go)(player.nodes[name])
    elif begins:
        player.kill(name)
    else:
        player.start(name, () if effect == "killed" else ("checkpoint",))
