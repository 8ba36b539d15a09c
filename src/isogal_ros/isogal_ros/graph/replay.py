"""Feeding recorded sensor messages to a fresh matcher and filter: how their fixes differ from the
recorded ones, and what was used of the recording."""

import math
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pydantic import JsonValue

from isogal.earth.frames import horizontal_difference
from isogal.errors import InputError
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.record import Collector
from isogal_ros.graph.player import LATE, Player, Recorded, load
from isogal_ros.graph.running import Progress, Report
from isogal_ros.messages.aids import each_aid
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.nodes.signals import Interrupt
from isogal_ros.topics import Topic

_HOW = (
    "; a replay takes parameters of ukf_fusion_node by --parameter NAME=VALUE, and messages of"
    " another frame or unit by --driver TOPIC.frame=NAME"
)


@dataclass(frozen=True)
class Replay:
    """What a replay leaves behind."""

    scenario: Scenario
    outputs: Collector
    """Messages of the fresh nodes, with the recorded truth."""
    recorded: int
    """Fixes recorded, without those that say there is none."""
    replayed: int
    common: int
    """Stamps at which both gave a fix."""
    disagreements: int | None
    """Stamps at which one gave a fix and the other said there is none, or nothing; None = the
    recording says nothing of any batch, so that there is nothing to compare with."""
    largest_difference: float | None
    """m, between fixes of the same stamp; None = there is none in common."""
    simulated: float
    """s replayed."""
    wall_seconds: float
    notes: list[str]
    """What was missing, or cut off."""
    failures: list[str]
    """Why the replay shows nothing: sensors of which no message was used, and that there was no
    fix; empty where it was interrupted."""
    interrupted: bool
    filter: InertialNavigator | None
    """The fresh filter, with its history; None = it has not begun."""


def replay(
    reader: BagReader,
    interrupt: Interrupt,
    report: Report = lambda _: None,
    scenario: Scenario | None = None,
    parameters: Mapping[str, JsonValue] | None = None,
) -> Replay:
    """Replay a bag as fast as the nodes can.

    Parameters
    ----------
    scenario : Scenario, optional
        None = the bag's own.
    parameters : mapping, optional
        Own parameters of the filter's node by name (`isogal_ros.graph.parameter_files`).

    Raises
    ------
    InputError
        The bag lacks a topic that is needed, or a scenario, or its scenario cannot be used.
    """
    scenario = scenario or reader.scenario()
    if scenario is None:
        raise InputError(
            f"{reader.path}: the bag has no scenario (another tool has written it?); say with"
            " --scenario which one was run"
        )
    recorded = load(reader, scenario)
    begun = time.monotonic()
    # a simulated run that is recorded from its start on begins as the scenario says
    whole = bool(recorded.collector.truth) and recorded.first <= LATE
    start = {} if whole or recorded.start is None else recorded.start
    player = Player(recorded, {}, {**start, **(parameters or {})}, quiet=False)
    outputs = player.collector
    with player.bus:
        answered = _play(player, interrupt, report)
        failures = [] if interrupt else _shortcomings(player, answered)
        fusion = player.filter
    if not recorded.reduces:
        outputs.readings, outputs.others = recorded.collector.readings, recorded.collector.others
    return Replay(
        scenario,
        outputs,
        *_compare(recorded.collector, outputs, answered),
        to_seconds(answered) - recorded.first if answered else 0.0,
        time.monotonic() - begun,
        _notes(reader, recorded),
        failures,
        bool(interrupt),
        fusion,
    )


def _play(player: Player, interrupt: Interrupt, report: Report) -> int:
    """Play all; return the last stamp (ns) that was played, 0 = none."""
    stamps = sorted(player.recorded.sensors[player.recorded.inertial])
    begun, answered = time.monotonic(), 0
    for ns in player.steps():
        if interrupt:
            break
        answered = ns
        simulated, duration = (to_seconds(one - stamps[0]) for one in (ns, stamps[-1]))
        speed = simulated / max(time.monotonic() - begun, 1e-9)
        report(Progress(simulated, duration, speed, math.nan))
    return answered


def _notes(reader: BagReader, recorded: Recorded) -> list[str]:
    """Say what is missing, and what the replay does about it."""
    notes = []
    if reader.cut is not None:
        last = to_seconds(max(recorded.sensors[recorded.inertial]))
        notes.append(f"the bag is not read to its end: {reader.cut}; read up to {last:.0f} s")
    if recorded.first > LATE and not recorded.scenario.ins.gives_solution:
        how = (
            "as the scenario says for its start, which is true only where the vehicle did not move"
            " before"
            if recorded.start is None
            else "where the recorded navigator was"
        )
        notes.append(f"the bag begins at {recorded.first:.0f} s: the filter starts there {how}")
    by_navigator = all(one.readings.source is None for one in recorded.scenario.each_field)
    if by_navigator and {topics.GRAVITY, topics.DISTURBANCE} & {*recorded.readings}:
        notes.append(
            "the gravimeter's own readings are not all in the bag: those that are fed were reduced"
            " with the recorded navigator's velocity, and are wrong by the Eötvös effect of what"
            " the replayed one differs from it"
        )
    return notes


def _compare(
    recorded: Collector, replayed: Collector, last_ns: int
) -> tuple[int, int, int, int | None, float | None]:
    """Compare the fixes up to a stamp; return `recorded` to `largest_difference` of a replay."""
    old = {ns: fix for ns, fix in recorded.fix_positions().items() if ns <= last_ns}
    new = replayed.fix_positions()
    differences = [
        float(np.hypot(*horizontal_difference(*place, *was)))
        for ns, was in old.items()
        if was is not None and (place := new.get(ns)) is not None
    ]
    apart = sum((old.get(ns) is None) != (new.get(ns) is None) for ns in {*old, *new})
    before, after = (sum(fix is not None for fix in one.values()) for one in (old, new))
    largest = max(differences, default=None)
    return before, after, len(differences), apart if old else None, largest


def _shortcomings(player: Player, answered: int) -> list[str]:
    """Return one line for each sensor of which no message was used up to a stamp, and one where
    there was no fix."""
    recorded, fusion = player.recorded, player.nodes[topics.UKF_FUSION]
    dropped: Counter[str] = Counter()
    why: dict[str, str] = {}
    for node in player.nodes.values():
        dropped.update(node.health.dropped)
        why |= node.health.why
    unused: dict[Topic, str] = {}
    """Why, where no message was dropped."""
    inertial = recorded.inertial
    if fusion.outputs.newest < 0 or dropped[inertial.name] >= len(recorded.sensors[inertial]):
        unused[inertial] = fusion.health.message
    for aid in each_aid(recorded.scenario):
        either = aid.topic, *aid.instead
        if not any(fusion.health.figures.get(f"{one.name} used", 0) for one in either):
            unused[aid.topic] = "the filter had no state to which it could apply them"
    for topic in recorded.readings:
        stamps = recorded.sensors[topic]
        if stamps and dropped[topic.name] >= sum(ns <= answered for ns in stamps):
            unused[topic] = "all come after the last IMU sample"
    found = []
    for topic, otherwise in unused.items():
        name, count = topic.name, len(recorded.sensors[topic])
        reason = f"{dropped[name]} dropped: {why[name]}" if dropped[name] else otherwise
        found.append(f"{name}: none of {count} messages was used: {reason}{_HOW}")
    if all(place is None for place in player.collector.fix_positions().values()):
        found.append(f"no fix: {_why_no_fix(player.collector)}")
    return found


def _why_no_fix(outputs: Collector) -> str:
    """Say why no batch gave a fix."""
    reasons = Counter(figures["message"] for figures in outputs.batches.values())
    if not reasons:
        lengths = [one.matcher.batch_length for one in outputs.scenario.each_field]
        return f"no batch ended (matcher.batch_length: {', '.join(map(str, lengths))} scans)"
    ((reason, count),) = reasons.most_common(1)
    return f"{reasons.total()} batches gave none: {reason} ({count} times)"
