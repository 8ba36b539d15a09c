"""Trials with a process for each node: those that are killed are started again, others are
stopped for a while, or slow."""

import shutil
import signal
import time
from pathlib import Path

import numpy as np
from rclpy.serialization import deserialize_message

from isogal.errors import InputError
from isogal_ros import topics
from isogal_ros.bags.collect import Collector
from isogal_ros.bags.reader import BagReader, topic_of
from isogal_ros.faults.catalogue import Fault
from isogal_ros.faults.judgement import Row, Span, outcome_of
from isogal_ros.faults.stage import Feed
from isogal_ros.graph.plan import GraphError, Plan
from isogal_ros.graph.processes import Processes, run_processes
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.nodes.signals import Interrupt

PATIENCE = 300.0
"""s of wall time after which a run that does not arrive hangs."""
TURN = 0.1
"""s of wall time that a slow process is stopped, and then goes."""
EARLIER = 15.0
"""s that a report may be stamped before the fault: with the last data that could be used."""
SECOND = 1e9


class Signals:
    """Does a fault to the processes of a run (`run_processes`).

    Parameters
    ----------
    fault : Fault
    begin : float
        s of simulated time.
    """

    def __init__(self, fault: Fault, begin: float) -> None:
        self._fault, self._begin = fault, begin
        self._since, self._acts = float("inf"), False
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
        if self._acts == self._fault.is_on(elapsed, TURN):
            return
        self._acts = not self._acts
        stop = signal.SIGKILL if self._fault.effect == "killed" else signal.SIGSTOP
        for name in self._fault.targets:
            if processes.running[name].poll() is None:
                processes.running[name].send_signal(stop if self._acts else signal.SIGCONT)


def run_process_trial(feed: Feed, fault: Fault, folder: Path, interrupt: Interrupt) -> Row | None:
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
    signals, limit = Signals(fault, begin), time.monotonic() + PATIENCE

    def meddle(processes: Processes, simulated: float) -> None:
        if time.monotonic() > limit:
            raise GraphError(f"the run did not arrive within {PATIENCE:g} s")
        signals(processes, simulated)

    crash, collector = None, Collector(feed.scenario)
    try:
        run_processes(plan, folder / "log", interrupt, lambda progress: None, meddle=meddle)
        if not interrupt:
            collector.take_bag(BagReader(folder / "bag"))
    except (GraphError, InputError) as error:
        crash = f"{type(error).__name__}: {error}"
    span = Span(begin, begin + 10.0, 2.0 / 3.0 * feed.duration, feed.duration)
    reports = ((to_seconds(ns), text) for ns, text in collector.warnings)
    late = (report for report in reports if report[0] >= begin - EARLIER)
    outcome = outcome_of(fault, feed, span, collector, late, crash)
    if crash is None and not interrupt:
        outcome["restart"] = _silence(folder / "bag", fault, signals)
    if crash is None or interrupt:
        shutil.rmtree(folder)
    return None if interrupt else outcome


def _silence(bag: Path, fault: Fault, signals: Signals) -> float:
    """Return for how long (s of wall time) a faulty node said nothing in its diagnostics, at most,
    from shortly before the fault on."""
    heard: dict[str, list[int]] = {name: [] for name in fault.targets}
    for message in BagReader(bag).messages():
        is_early = message.publish_ns < signals.begun_ns - 2 * SECOND
        if is_early or not topic_of(message.topic, topics.DIAGNOSTICS.name):
            continue
        for item in deserialize_message(message.data, topics.DIAGNOSTICS.type).status:
            heard.get(item.name.rpartition("/")[2], []).append(message.publish_ns)
    gaps = [np.diff(stamps).max(initial=0) for stamps in heard.values()]
    return float(max(gaps, default=0)) / SECOND
