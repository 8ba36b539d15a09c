"""The campaign: a run without fault, and the same with one fault from a time on, played to fresh
nodes; every fault some times, the outcomes on disk one by one, so that it can be interrupted and
goes on; in the end each fault is judged by all of its trials, in a table."""

import json
import math
import re
import signal
import tempfile
import traceback
from collections import defaultdict
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import typer
from pydantic import JsonValue
from rclpy.serialization import deserialize_message, serialize_message

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.results import plain, write_json
from isogal.files import write_atomic
from isogal.scenario import Scenario
from isogal.seeds import generator
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.record import Collector
from isogal_ros.faults.catalogue import FAULTS, QUICK, Fault, Moment, topics_of
from isogal_ros.graph.plan import Plan
from isogal_ros.graph.player import TICK, Player, Recorded, load
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
OUTCOMES, TABLE, PAGE = "outcomes.jsonl", "faults.json", "faults.md"
QUICK_DURATION = 600.0
"""s of the route of a quick campaign."""
RECOVERED = 1.3
"""Of the error of the same runs without fault at the same time, RMS."""
ALLOWANCE = 30.0
"""m of error that is no harm in a single trial, where there is hardly any without fault; of n
trials it is as much less as the RMS of n runs is surer."""
HEAD = """\
reported: trials in which the diagnostics said WARN or ERROR, and after how many seconds, the
median (in brackets: it need not be reported). Errors in m: the largest during the fault; RMS after
it, with the fault and without; ratio of the two. lost: states, readings and fixes of a stamp.

| fault | trials | reported | after, s | during | after | without | ratio | lost | passed |
|---|---|---|---|---|---|---|---|---|---|"""
Table = dict[str, Any]
"""``faults.json``: of each fault what became of all its trials, how many there were of all faults,
and which have not passed."""


@dataclass(frozen=True)
class Outcome:
    """What became of the navigator in a run with a fault: a line of ``outcomes.jsonl``. Times in
    s, errors in m; NaN = not known, or it did not happen."""

    fault: str
    trial: int
    errors: list[str]
    """What ended a node, that the trial hung, and exceptions that were not foreseen."""
    not_finite: int
    """States that were not finite."""
    reported_after: float
    report: str | None
    error_during: float
    """The largest."""
    error_after: float
    """RMS, as the error of the run without fault."""
    error_without: float
    lost: int


class Track(NamedTuple):
    """The navigator's horizontal error and 1-sigma (N,), m, at times (N,), s; NaN where its state
    is not finite."""

    time: Array
    error: Array
    sigma: Array

    def during(self, begin: float, end: float) -> Array:
        """Return the errors that are known between two times (s)."""
        within = (self.time > begin) & (self.time <= end)
        return self.error[within & np.isfinite(self.error)]


def track_of(collector: Collector) -> Track:
    """Return the navigator's error against the recorded truth."""
    stamps = sorted(collector.last_nav.keys() & collector.truth.keys())
    rows = np.full((len(stamps), 3), np.nan)
    for row, ns in zip(rows, stamps, strict=True):
        row[0] = to_seconds(ns)
        fix = deserialize_message(collector.last_nav[ns], topics.NAV_FIX.type)
        if np.isfinite([fix.latitude, fix.longitude, *fix.position_covariance]).all():
            truth = deserialize_message(collector.truth[ns], topics.TRUTH_FIX.type)
            off = horizontal_difference(*read_position(fix)[:2], *read_position(truth)[:2])
            variance = fix.position_covariance[0] + fix.position_covariance[4]
            row[1:] = np.hypot(*off), np.sqrt(variance)
    return Track(*rows.T)


def simulated(scenario: Scenario, run: int, interrupt: Interrupt | None = None) -> Recorded:
    """Simulate a run without fault, and return what its sensors measured and what was answered.

    Raises
    ------
    InputError
        The scenario cannot be used.
    GraphError
        A node failed.
    KeyboardInterrupt
        The simulation was interrupted.
    """
    interrupt = Interrupt() if interrupt is None else interrupt
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        run_in_process(Plan(scenario, bag, run=run), interrupt)
        if interrupt:
            raise KeyboardInterrupt
        return load(BagReader(bag), scenario)


def player_of(recorded: Recorded, **own: JsonValue) -> Player:
    """Return fresh nodes, with own parameters, that a run is played to."""
    return Player(recorded, {"diagnostics_period": 2.0 * TICK, **own}, {})


def _hang(*_: object) -> None:
    """End a trial, by what no node takes for something wrong with a message."""
    raise SystemExit(f"nothing came within {LIMIT:g} s")


def run_trial(recorded: Recorded, fault: Fault) -> Outcome:
    """Play a run with a fault, which begins at a time drawn from seed, run and its name, and
    return what became of it."""
    rng = generator(recorded.scenario.seed, recorded.run, f"fault: {fault.name}")
    usual, without = recorded.collector, track_of(recorded.collector)
    duration = without.time[-1]
    begin = float(np.floor(rng.uniform(0.25, 0.45) * duration))
    over = begin + fault.lasts + 1.0
    after = over + RECOVERY * duration
    until = after + LOOKED_AT * duration
    errors: list[str] = []
    with tempfile.TemporaryDirectory(prefix="isogal-faults-") as folder:
        # checkpoints take time, and only nodes that are killed need them
        own = {"checkpoint": folder} if isinstance(fault.effect, str) else {}
        player = player_of(recorded, **own)
        with player.bus:
            player.play(begin - 1e-9)
            known = len(player.reports)
            signal.signal(signal.SIGALRM, _hang)
            signal.setitimer(signal.ITIMER_REAL, LIMIT)
            try:
                _play(player, fault, begin, until, rng)
            except (Exception, SystemExit):
                errors.append(traceback.format_exc(limit=-3))
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0.0)
    track, found = track_of(player.collector), player.collector
    said = {without_numbers(f"{one.source}: {one.text}") for one in usual.said}
    new = (one for one in player.reports[known:] if without_numbers(one[1]) not in said)
    first, text = next(new, (math.nan, None))
    errors += [without_numbers(one) for one in player.bus.errors if UNEXPECTED.search(one)]
    lost = [getattr(usual, one).keys() - getattr(found, one).keys() for one in STORES]
    return Outcome(
        fault.name,
        recorded.run,
        list(dict.fromkeys(errors)),
        int(np.isnan(track.error).sum()),
        first if math.isnan(first) else max(first - begin, 0.0),
        text,
        float(track.during(begin - 1e-9, over).max(initial=0.0)),
        _rms(track.during(after, until)),
        _rms(without.during(after, until)),
        sum(to_seconds(ns) <= until for stamps in lost for ns in stamps),
    )


def _play(
    player: Player, fault: Fault, begin: float, until: float, rng: np.random.Generator
) -> None:
    """Play a run from where a player is, with a fault that begins now (s), up to a time (s)."""
    of_source = topics_of(fault.targets[0], player.recorded.readings)
    types = {topic.name: topic.type for topic in of_source}
    moments: defaultdict[str, Moment] = defaultdict(lambda: Moment(rng))

    def change(topic: str, data: bytes) -> list[bytes]:
        """Return what comes instead of a serialised message."""
        effect, since = fault.effect, player.bus.now - begin
        if isinstance(effect, str) or topic not in types or not fault.is_on(since):
            return [data]
        moment, kind = moments[topic], types[topic]
        moment.since = since
        moment.came.append(deserialize_message(data, kind))
        return [serialize_message(one) for one in effect(deserialize_message(data, kind), moment)]

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


def run_campaign(
    scenario: Scenario, out: Path, trials: int, quick: bool, interrupt: Interrupt
) -> Table:
    """Run what has not been run yet, with a line on standard error for each outcome, write table
    and page, and return the table.

    Parameters
    ----------
    scenario : Scenario
    out : Path
        Folder of the outcomes.
    trials : int
        Of each fault.
    quick : bool
        Whether only the faults of `QUICK` are run, over `QUICK_DURATION` at most.
    interrupt : Interrupt

    Raises
    ------
    InputError
        Scenario or folder cannot be used.
    GraphError
        The run without fault failed.
    """
    done = _read(out / OUTCOMES)
    faults = [one for one in FAULTS if not quick or one.name in QUICK]
    if quick:
        known = scenario.route.duration or QUICK_DURATION
        short = {"duration": min(known, QUICK_DURATION)}
        route = scenario.route.model_copy(update=short)
        scenario = scenario.model_copy(update={"route": route})
    with suppress(KeyboardInterrupt):  # what has been run makes the table
        for trial in range(trials):
            due = [one for one in faults if (one.name, trial) not in done]
            if not due or interrupt:
                continue
            recorded = simulated(scenario, trial, interrupt)
            interrupt.ends_at_once = True
            for fault in due:
                found = done[fault.name, trial] = run_trial(recorded, fault)
                with (out / OUTCOMES).open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(plain(asdict(found))) + "\n")
                after, error = found.reported_after, found.error_after
                words = "not reported" if math.isnan(after) else f"reported after {after:.0f} s"
                said = f"{fault.name}, trial {trial}: {words}, error {error:.0f} m after it"
                typer.echo(", ".join([said, *found.errors]), err=True)
            interrupt.ends_at_once = False
    interrupt.ends_at_once = False
    table = table_of(scenario, faults, done.values())
    write_json(out / TABLE, table)
    write_atomic(out / PAGE, page_of(table))
    return table


def _read(path: Path) -> dict[tuple[str, int], Outcome]:
    """Return the outcomes on disk, without a line that is cut off or of another version."""
    found: dict[tuple[str, int], Outcome] = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        with suppress(ValueError, TypeError):
            known = {key: value for key, value in json.loads(line).items() if value is not None}
            unknown = dict.fromkeys(("reported_after", "error_after", "error_without"), math.nan)
            outcome = Outcome(**{"report": None, **unknown, **known})
            found[outcome.fault, outcome.trial] = outcome
    return found


def two_batches(scenario: Scenario) -> float:
    """Return how long two batches take, at most, s."""
    return 2.0 * scenario.matcher.batch_length * scenario.gravimeter.interval


def table_of(scenario: Scenario, faults: Iterable[Fault], outcomes: Iterable[Outcome]) -> Table:
    """Return the table of those faults of which there are outcomes."""
    known, limit = list(outcomes), two_batches(scenario)
    own = ((fault, [one for one in known if one.fault == fault.name]) for fault in faults)
    rows = [_row(fault, found, limit) for fault, found in own if found]
    failed = [row["fault"] for row in rows if row["failures"]]
    return {"faults": rows, "trials": sum(row["trials"] for row in rows), "failed": failed}


def _row(fault: Fault, outcomes: Sequence[Outcome], limit: float) -> Table:
    """Judge a fault, which is reported in time within a limit (s), by all of its trials: what it
    has not passed for are `failures`. None = not known, or nothing was reported."""
    after = [o.reported_after for o in outcomes if not math.isnan(o.reported_after)]
    rms, without = _rms(o.error_after for o in outcomes), _rms(o.error_without for o in outcomes)
    allowed = RECOVERED * without + ALLOWANCE / len(outcomes) ** 0.5
    late = len(outcomes) - sum(one <= limit for one in after)
    wrong = {
        "state not finite": sum(o.not_finite for o in outcomes),
        "not reported in time": late if fault.matters else 0,
        "not recovered from": int(not rms <= allowed),
    }
    failures = [f"{count} x {what}" for what, count in wrong.items() if count]
    failures += sorted({text.splitlines()[-1] for o in outcomes for text in o.errors})
    row = {
        "fault": fault.name,
        "trials": len(outcomes),
        "matters": fault.matters,
        "reported": len(after),
        "reported_after_s": np.median(after) if after else None,
        "report": next((o.report for o in outcomes if o.report), None),
        "error_during_m": max(o.error_during for o in outcomes),
        "error_after_m": rms,
        "error_without_m": without,
        "ratio": rms / without if without else None,
        "lost": max(o.lost for o in outcomes),
        "failures": failures,
    }
    return {name: plain(value) for name, value in row.items()}


def _rms(values: Iterable[float]) -> float:
    """Return the root mean square; NaN where a value is missing, or all are."""
    found = np.array(list(values), dtype=float)
    return float(np.sqrt(np.mean(found**2))) if found.size else math.nan


def page_of(table: Table) -> str:
    """Return a table as a page."""
    passed = f"passed: all but {', '.join(table['failed'])}" if table["failed"] else "all passed"
    summary = f"{len(table['faults'])} faults, {table['trials']} trials; {passed}."
    return "\n".join(["# Faults", "", summary, "", HEAD, *map(_line, table["faults"])]) + "\n"


def _line(row: Table) -> str:
    numbers = ((row[f"error_{when}_m"], ".0f") for when in ("during", "after", "without"))
    each = (row["reported_after_s"], ".0f"), *numbers, (row["ratio"], ".2f")
    cells = ["–" if value is None else format(value, form) for value, form in each]
    reported = f"{row['reported']}" if row["matters"] else f"({row['reported']})"
    passed = f"**no**: {'; '.join(row['failures'])}" if row["failures"] else "yes"
    first = [row["fault"], str(row["trials"]), reported]
    return f"| {' | '.join([*first, *cells, str(row['lost']), passed])} |"
