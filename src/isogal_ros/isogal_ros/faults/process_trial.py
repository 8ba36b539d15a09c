"""One trial of a fault of processes: a graph whose nodes are started again where they die."""

import shutil
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
from rclpy.serialization import deserialize_message

from isogal.errors import InputError
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.collect import Collector
from isogal_ros.bags.reader import BagReader, topic_of
from isogal_ros.faults.outcome import Outcome, Span, first_warning, outcome_of, track_of
from isogal_ros.faults.process_faults import Meddler, ProcessFault
from isogal_ros.faults.trial import begin_of
from isogal_ros.graph.in_process import run_in_process
from isogal_ros.graph.plan import GraphError, Plan
from isogal_ros.graph.processes import Meddle, Processes, run_processes
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.nodes.signals import Interrupt

SECOND = 1e9


def record_reference(scenario: Scenario, bag: Path, run: int, interrupt: Interrupt) -> bool:
    """Record a run without fault, whole or, where it is interrupted, not at all; return whether it
    is there."""
    part = bag.with_suffix(".part")
    shutil.rmtree(part, ignore_errors=True)
    run_in_process(Plan(scenario, part, run=run), interrupt, lambda progress: None)
    if interrupt:
        return False
    part.rename(bag)
    return True


def run_process_trial(
    scenario: Scenario,
    folder: Path,
    reference: Path,
    fault: ProcessFault,
    trial: int,
    stop: Interrupt | None = None,
) -> Outcome | None:
    """Run a graph with a fault at a time that is drawn from seed, trial and fault; return its
    outcome, None where it was stopped.

    Parameters
    ----------
    folder : Path
        For recording, logs and checkpoints; emptied first, and deleted unless something failed.
    reference : Path
        Recording of the same run without fault: messages that it has and the trial has not are
        lost.
    trial : int
        Index of the run.
    stop : Interrupt, optional
        Ends it early.
    """
    begin, _ = begin_of(scenario.seed, trial, fault.name, scenario.route.duration or 0.0)
    shutil.rmtree(folder, ignore_errors=True)
    checkpoint = folder / "checkpoint"
    checkpoint.mkdir(parents=True)
    plan = Plan(scenario, folder / "bag", run=trial, checkpoint=checkpoint)
    interrupt = Interrupt()
    meddler = Meddler(fault, begin, interrupt)
    crash, collector = None, Collector(scenario)
    meddle = _until(stop, interrupt, meddler)
    try:
        run_processes(plan, folder / "log", interrupt, lambda progress: None, meddle=meddle)
        if stop:
            shutil.rmtree(folder)
            return None
        collector.take_bag(BagReader(folder / "bag"))
    except (GraphError, InputError) as error:
        crash = f"{type(error).__name__}: {error}"
    if meddler.hung:
        crash = "the run did not arrive"
    before = Collector(scenario)
    before.take_bag(BagReader(reference))
    duration = to_seconds(max(before.truth))
    span = Span(begin, begin + 10.0, 2.0 / 3.0 * duration, duration)
    tracks = track_of(collector), track_of(before)
    outcome = replace(
        outcome_of(fault.name, trial, span, tracks, first_warning(collector, begin)),
        crash=crash,
        restart=None if crash else _silence(folder / "bag", fault, meddler.begun_ns),
        lost=_lost(before, collector),
    )
    if crash is None:
        shutil.rmtree(folder)
    return outcome


def _until(stop: Interrupt | None, interrupt: Interrupt, meddler: Meddler) -> Meddle:
    """Return what does as the meddler, and passes `stop` on to the run."""

    def meddle(processes: Processes, simulated: float) -> None:
        if stop:
            interrupt(signal.SIGINT)
        meddler(processes, simulated)

    return meddle


def _lost(reference: Collector, collector: Collector) -> int:
    """Return how many messages of a stamp one has and the other has not."""
    pairs = (
        (reference.truth, collector.truth),
        (reference.last_nav, collector.last_nav),
        (reference.readings, collector.readings),
        (reference.fixes, collector.fixes),
    )
    return sum(len(old.keys() - new.keys()) for old, new in pairs)


def _silence(bag: Path, fault: ProcessFault, begun_ns: int) -> float:
    """Return for how long (s of wall time) a faulty node said nothing in its diagnostics, at most,
    from shortly before the fault on."""
    heard: dict[str, list[int]] = {name: [] for name in fault.nodes}
    for message in BagReader(bag).messages():
        is_early = message.publish_ns < begun_ns - 2 * SECOND
        if is_early or not topic_of(message.topic, topics.DIAGNOSTICS.name):
            continue
        for item in deserialize_message(message.data, topics.DIAGNOSTICS.type).status:
            name = item.name.rpartition("/")[2]
            if name in heard:
                heard[name].append(message.publish_ns)
    gaps = [np.diff(stamps).max(initial=0) for stamps in heard.values()]
    return float(max(gaps, default=0)) / SECOND
