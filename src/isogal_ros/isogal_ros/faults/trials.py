"""Trials: a run without fault, and the rest of it with one fault from a time on, played to fresh
nodes in this process, or run anew with a process for each node.

All faults of a run within one process share what comes before them: the run is played once, and
where a fault begins a process is forked off that plays the rest with it."""

import gc
import math
import multiprocessing
import re
import shutil
import signal
import tempfile
import time
import traceback
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import JsonValue
from rclpy.serialization import deserialize_message, serialize_message

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.errors import InputError
from isogal.scenario import Scenario
from isogal.seeds import generator
from isogal_ros import topics
from isogal_ros.bags.collect import Collector
from isogal_ros.bags.reader import BagReader, topic_of
from isogal_ros.faults.catalogue import Fault, Moment, topics_of
from isogal_ros.faults.judgement import Outcome, rms_of
from isogal_ros.graph.plan import GraphError, Plan
from isogal_ros.graph.player import TICK, Player
from isogal_ros.graph.recorded import load
from isogal_ros.graph.running import Processes, run_in_process, run_processes
from isogal_ros.messages.position import read_position
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.nodes.signals import Interrupt

LIMIT, PROCESS_LIMIT = 120.0, 300.0
"""s of wall time after which a trial hangs, in one process and of processes."""
UNEXPECTED = re.compile(r": \w*(Error|Exception|Warning): ")
"""In what a node logs of an exception (`GraphNode.guard`)."""
MOST_ERRORS = 20
"""Kept of a trial."""
RECOVERY, LOOKED_AT = 2.0 / 9.0, 1.0 / 6.0
"""Shares of a run's duration: after a fault it has so long to recover, and is looked at for so
long then."""
TURN, PROCESS_TURN = 20.0, 0.1
"""s that a slow node takes nothing, and then goes; of processes of wall time."""
EARLIER = 15.0
"""s that a report may be stamped before the fault: with the last data that could be used."""
SECOND = 1e9
STORES = ("truth", "last_nav", "readings", "fixes")
"""Messages of a `Collector` that are lost where only the run without fault has their stamp."""
_FORK = multiprocessing.get_context("fork")


class Track(NamedTuple):
    """The navigator's horizontal error and 1-sigma (N,), m, at times (N,), s."""

    time: Array
    error: Array
    sigma: Array
    not_finite: int
    """States that were not finite."""


class Span(NamedTuple):
    """When a fault was, and when it is looked at how it was recovered from, s."""

    begin: float
    end: float
    after: float
    until: float


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

    def begin_of(self, fault: str) -> tuple[float, np.random.Generator]:
        """Return when (s) a fault begins, drawn from seed, run and its name, and the random
        numbers that follow."""
        rng = generator(self.scenario.seed, self.run, f"fault: {fault}")
        return float(np.floor(rng.uniform(0.25, 0.45) * self.duration)), rng

    def player(self, checkpoints: Path | None = None) -> Player:
        """Return fresh nodes that the run is played to; they write checkpoints into a folder, if
        there is one."""
        own: dict[str, JsonValue] = {"diagnostics_period": 2.0 * TICK}
        if checkpoints is not None:
            own["checkpoint"] = str(checkpoints)
        return Player(replace(self.recorded, scenario=self.scenario), own, {})

    def outcome(
        self,
        fault: Fault,
        span: Span,
        collector: Collector,
        reports: Iterable[tuple[float, str]],
        crash: str | None,
    ) -> Outcome:
        """Return what became of the navigator in this run with a fault.

        Parameters
        ----------
        fault : Fault
        span : Span
        collector : Collector
            What was published.
        reports : iterable
            When (s) something was reported at WARN or ERROR because of the fault, and what.
        crash : str or None
            What ended a node, or that the trial hung; None = nothing did.
        """
        track, plain = track_of(collector), self.track
        during = track.error[(track.time >= span.begin) & (track.time <= span.end)]
        after, without = (
            (one.time > span.after) & (one.time <= span.until) for one in (track, plain)
        )
        first, text = next(iter(reports), (None, None))
        kept = [[getattr(one, name) for name in STORES] for one in (self.collector, collector)]
        return {
            "fault": fault.name,
            "trial": self.run,
            "crash": crash,
            "restart": None,
            "unexpected_errors": [],
            "begin": span.begin,
            "not_finite": track.not_finite,
            "reported_after": None if first is None else max(first - span.begin, 0.0),
            "report": text,
            "error_during": float(during.max(initial=0.0)),
            "error_after": rms_of(track.error[after]),
            "sigma_after": rms_of(track.sigma[after]),
            "error_without": rms_of(plain.error[without]),
            "lost": sum(
                to_seconds(ns) <= span.until
                for before, now in zip(*kept, strict=True)
                for ns in before.keys() - now.keys()
            ),
        }


def without_numbers(text: str) -> str:
    """Return a report or an error without its numbers."""
    return re.sub(r"[0-9.]+", "", text)


def run_trials(feed: Feed, faults: Sequence[Fault]) -> Iterator[Outcome]:
    """Play a run, and yield what became of each fault, by the time it begins."""
    with tempfile.TemporaryDirectory(prefix="isogal-faults-") as folder:
        # checkpoints take time, and only nodes that are killed need them
        killing = any(isinstance(fault.effect, str) for fault in faults)
        player = feed.player(Path(folder) if killing else None)
        drawn = [(*feed.begin_of(fault.name), fault) for fault in faults]
        for begin, rng, fault in sorted(drawn, key=lambda item: item[0]):
            player.play(begin - 1e-9)
            with _unchanged(Path(folder)):
                yield _Trial(feed, player, fault, begin, rng).forked()


@contextmanager
def _unchanged(folder: Path) -> Iterator[None]:
    """Put a folder back, in the end, as it was."""
    with tempfile.TemporaryDirectory() as copy:
        shutil.copytree(folder, copy, dirs_exist_ok=True)
        yield
        shutil.rmtree(folder)
        shutil.copytree(copy, folder)


class _Trial:
    """The rest of a run, from where a player is, with a fault that begins now."""

    def __init__(
        self, feed: Feed, player: Player, fault: Fault, begin: float, rng: np.random.Generator
    ) -> None:
        self._feed, self._player, self._fault = feed, player, fault
        end = begin + fault.lasts + 1.0
        after = end + RECOVERY * feed.duration
        self._span = Span(begin, end, after, after + LOOKED_AT * feed.duration)
        topics = topics_of(fault.targets[0], player.recorded.readings)
        self._types = {topic.name: topic.type for topic in topics}
        self._moment = Moment(0.0, rng)

    def forked(self) -> Outcome:
        """Play it in a process of its own; return what became of it."""
        gc.freeze()
        receiving, sending = _FORK.Pipe(duplex=False)
        child = _FORK.Process(target=self._play, args=(sending,))
        try:
            child.start()
            sending.close()
            if receiving.poll(LIMIT):
                outcome: Outcome = receiving.recv()
                return outcome
            crash = f"nothing came within {LIMIT:g} s"
        except EOFError:
            crash = "the process ended"
        finally:
            if child.pid is not None:
                child.kill()
                child.join()
        return self._outcome(crash)

    def _play(self, sending: Connection) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends with the parent's trial
        player, fault, crash, acts = self._player, self._fault, None, False
        player.bus.change = self._change
        try:
            for ns in player.steps(self._span.until):
                is_on = fault.is_on(to_seconds(ns) - self._span.begin, TURN)
                if isinstance(fault.effect, str) and acts != is_on:
                    acts = is_on
                    self._act(fault.effect, acts)
        except Exception:
            crash = traceback.format_exc(limit=-3)
        sending.send(self._outcome(crash))

    def _change(self, topic: str, data: bytes) -> list[bytes]:
        """Return what comes instead of a serialised message."""
        effect, self._moment.since = self._fault.effect, self._player.bus.now - self._span.begin
        is_on = topic in self._types and self._fault.is_on(self._moment.since)
        if isinstance(effect, str) or not is_on:
            return [data]
        message = deserialize_message(data, self._types[topic])
        return [serialize_message(one) for one in effect(message, self._moment)]

    def _act(self, effect: str, begins: bool) -> None:
        """Let the fault of nodes begin or end."""
        player = self._player
        for name in self._fault.targets:
            if effect in ("killed", "begun anew"):
                if begins:
                    player.kill(name)
                else:
                    player.start(name, () if effect == "killed" else ("checkpoint",))
            elif begins:
                player.bus.stop(player.nodes[name])
            else:
                player.bus.go(player.nodes[name])

    def _outcome(self, crash: str | None) -> Outcome:
        player, feed = self._player, self._feed
        reports = (
            (time, text)
            for time, text in player.reports
            if time >= self._span.begin and without_numbers(text) not in feed.reports
        )
        found = feed.outcome(self._fault, self._span, player.collector, reports, crash)
        errors = (without_numbers(text) for text in player.bus.errors if UNEXPECTED.search(text))
        found["unexpected_errors"] = list(dict.fromkeys(errors))[:MOST_ERRORS]
        return found


class Signals:
    """Does a fault to the processes of a run (`run_processes`): those that are killed are started
    again, others are stopped for a while, or slow.

    Parameters
    ----------
    fault : Fault
    begin : float
        s of simulated time.
    """

    def __init__(self, fault: Fault, begin: float) -> None:
        self._fault, self._begin = fault, begin
        self._since, self._acts = math.inf, False
        self.begun_ns = 0
        """Wall time of the fault, ns; 0 = it did not come to it."""
        self.over = False
        """Whether the fault has been done."""

    def __call__(self, processes: Processes, simulated: float) -> None:
        """Do what is due when the run is at a simulated time (s)."""
        if not self.begun_ns and simulated >= self._begin:
            self._since, self.begun_ns = time.monotonic(), time.time_ns()
        elapsed = time.monotonic() - self._since
        self.over = elapsed >= self._fault.lasts
        if self._acts == self._fault.is_on(elapsed, PROCESS_TURN):
            return
        self._acts = not self._acts
        stop = signal.SIGKILL if self._fault.effect == "killed" else signal.SIGSTOP
        for name in self._fault.targets:
            if processes.running[name].poll() is None:
                processes.running[name].send_signal(stop if self._acts else signal.SIGCONT)


def run_process_trial(
    feed: Feed, fault: Fault, folder: Path, interrupt: Interrupt
) -> Outcome | None:
    """Run a graph with a fault at a time that is drawn; return what became of it, None where it
    was interrupted.

    Parameters
    ----------
    feed : Feed
    fault : Fault
    folder : Path
        For recording, logs and checkpoints; emptied first, and deleted unless something failed.
    interrupt : Interrupt
    """
    begin, _ = feed.begin_of(fault.name)
    shutil.rmtree(folder, ignore_errors=True)
    checkpoint = folder / "checkpoint"
    checkpoint.mkdir(parents=True)
    plan = Plan(feed.scenario, folder / "bag", run=feed.run, checkpoint=checkpoint)
    signals, limit = Signals(fault, begin), time.monotonic() + PROCESS_LIMIT

    def inject(processes: Processes, simulated: float) -> None:
        if time.monotonic() > limit:
            raise GraphError(f"the run did not arrive within {PROCESS_LIMIT:g} s")
        signals(processes, simulated)

    crash, collector = None, Collector(feed.scenario)
    try:
        run_processes(plan, folder / "log", interrupt, inject=inject)
        if not interrupt:
            collector.take_bag(BagReader(folder / "bag"))
    except (GraphError, InputError) as error:
        crash = f"{type(error).__name__}: {error}"
    span = Span(begin, begin + 10.0, 2.0 / 3.0 * feed.duration, feed.duration)
    reports = ((to_seconds(ns), text) for ns, text in collector.warnings)
    late = (report for report in reports if report[0] >= begin - EARLIER)
    outcome = feed.outcome(fault, span, collector, late, crash)
    if crash is None and not interrupt:
        outcome["restart"] = _silence(folder / "bag", fault, signals.begun_ns)
    if crash is None or interrupt:
        shutil.rmtree(folder)
    return None if interrupt else outcome


def _silence(bag: Path, fault: Fault, begun_ns: int) -> float:
    """Return for how long (s of wall time) a faulty node said nothing in its diagnostics, at most,
    from shortly before the fault on."""
    heard: dict[str, list[int]] = {name: [] for name in fault.targets}
    for message in BagReader(bag).messages():
        is_early = message.publish_ns < begun_ns - 2 * SECOND
        if is_early or not topic_of(message.topic, topics.DIAGNOSTICS.name):
            continue
        for item in deserialize_message(message.data, topics.DIAGNOSTICS.type).status:
            heard.get(item.name.rpartition("/")[2], []).append(message.publish_ns)
    gaps = [np.diff(stamps).max(initial=0) for stamps in heard.values()]
    return float(max(gaps, default=0)) / SECOND
