"""Trials: a run played to fresh nodes, with one fault in it.

All faults of a run share what comes before them: the run is played once, and where a fault begins
a process is forked off that plays the rest with it."""

import gc
import json
import os
import re
import select
import signal
import tempfile
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

from isogal.seeds import generator
from isogal_ros.faults.catalogue import Fault, Moment, topics_of
from isogal_ros.faults.node_faults import Mishap, NodeFault
from isogal_ros.faults.outcome import Outcome, Span, Track, outcome_of, track_of
from isogal_ros.faults.stage import Feed, Stage
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.nodes.signals import Interrupt

LIMIT = 120.0
"""s of wall time after which a trial hangs."""
UNFORESEEN = re.compile(r": \w*(Error|Exception|Warning): ")
"""In what a node logs of an exception (`GraphNode.guard`)."""
RECOVERY, LOOKED_AT = 2.0 / 9.0, 1.0 / 6.0
"""Shares of a run's duration: after a fault it has so long to recover, and is looked at for so
long then."""
SURPRISES = 20
"""Kept of a trial."""


class Tampering:
    """A fault within a time, applied to messages on a bus.

    Parameters
    ----------
    fault : Fault
    begin : float
        s.
    rng : Generator
    stage : Stage
        Says what time it is.
    """

    def __init__(self, fault: Fault, begin: float, rng: np.random.Generator, stage: Stage) -> None:
        self._fault, self._begin, self._bus = fault, begin, stage.bus
        raw = adapter_of(stage.feed.scenario).raw
        self._types = {topic.name: topic.type for topic in topics_of(fault, raw)}
        self._moment = Moment(0.0, rng, {})

    def __call__(self, topic: str, data: bytes) -> list[bytes]:
        """Return what comes instead of a serialised message."""
        since = self._bus.now - self._begin
        if topic not in self._types or not 0.0 <= since < self._fault.lasts:
            return [data]
        self._moment.since = since
        changed = self._fault.change(deserialize_message(data, self._types[topic]), self._moment)
        return [serialize_message(message) for message in changed]


def begin_of(seed: int, trial: int, name: str, duration: float) -> tuple[float, Any]:
    """Return when (s) a fault begins in a run of a duration (s), drawn from seed, trial and fault,
    and the random numbers that follow."""
    rng = generator(seed, trial, f"fault: {name}")
    return float(np.floor(rng.uniform(0.25, 0.45) * duration)), rng


@dataclass(frozen=True)
class Reference:
    """A run without a fault."""

    track: Track
    said: frozenset[str]
    """What was said at WARN or ERROR, without its numbers."""

    @classmethod
    def of(cls, feed: Feed, interrupt: Interrupt | None = None) -> "Reference":
        """Play a run without a fault, to its end or an interrupt."""
        stage = Stage(feed)
        for ns in stage.stamps():
            if interrupt:
                break
            stage.play(ns)
        return cls(track_of(stage.collector), frozenset(shape(text) for _, text in stage.heard))

    def outcome(self, run: int) -> Outcome:
        """Return its outcome, over its last third."""
        end = float(self.track.time.max(initial=0.0))
        span = Span(0.0, 0.0, 2.0 / 3.0 * end, end)
        return outcome_of("none", run, span, (self.track, self.track))


def run_trials(
    feed: Feed, faults: Sequence[Fault | NodeFault], reference: Reference, interrupt: Interrupt
) -> Iterator[Outcome]:
    """Play a run, and yield what became of each fault, by the time it begins."""
    seed = feed.scenario.seed
    with tempfile.TemporaryDirectory(prefix="isogal-faults-") as folder:
        killing = any(isinstance(fault, NodeFault) for fault in faults)
        stage = Stage(feed, Path(folder) if killing else None)
        drawn = [
            (*begin_of(seed, feed.run, fault.name, stage.duration), fault) for fault in faults
        ]
        waiting = sorted(drawn, key=lambda item: item[0], reverse=True)
        for ns in stage.stamps():
            while waiting and waiting[-1][0] <= to_seconds(ns) and not interrupt:
                begin, rng, fault = waiting.pop()
                with unchanged(stage.checkpoints):
                    outcome = Forked(stage, fault, begin, rng, reference).run()
                yield outcome
            if interrupt or not waiting:
                return
            stage.play(ns)


def shape(text: str) -> str:
    """Return what was said without its numbers."""
    return re.sub(r"[0-9.]+", "", text)


@dataclass
class Forked:
    """The rest of a run with a fault, in a process of its own."""

    stage: Stage
    fault: Fault | NodeFault
    begin: float
    """s."""
    rng: Any
    reference: Reference

    def run(self) -> Outcome:
        """Play it; return what became of it."""
        gc.freeze()
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            try:
                os.close(reading)
                signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent waits for it
                gc.disable()  # what it leaves behind goes with it
                os.write(writing, json.dumps(self._played().__dict__).encode())
            finally:
                os._exit(0)
        os.close(writing)
        heard, _, _ = select.select([reading], [], [], LIMIT)
        if not heard:
            os.kill(child, signal.SIGKILL)
        with os.fdopen(reading, "rb") as stream:
            data = stream.read()
        os.waitpid(child, 0)
        if data:
            return Outcome(**json.loads(data))
        why = "the process ended" if heard else f"nothing came within {LIMIT:g} s"
        nothing = outcome_of(
            self.fault.name, self.stage.feed.run, self._span, (Track(), self.reference.track)
        )
        return replace(nothing, crash=why)

    @property
    def _span(self) -> Span:
        duration, end = self.stage.duration, self.begin + self.fault.lasts + 1.0
        after = end + RECOVERY * duration
        return Span(self.begin, end, after, after + LOOKED_AT * duration)

    def _played(self) -> Outcome:
        stage, span, crash = self.stage, self._span, None
        mishap: Callable[[float], object] = float
        if isinstance(self.fault, NodeFault):
            mishap = Mishap(self.fault, self.begin, stage)
        else:
            stage.bus.change = Tampering(self.fault, self.begin, self.rng, stage)
        try:
            for ns in stage.stamps():
                if to_seconds(ns) > span.until:
                    break
                mishap(to_seconds(ns))
                stage.play(ns)
        except Exception:
            crash = traceback.format_exc(limit=-3)
        told = (
            item
            for item in stage.heard
            if item[0] >= self.begin and shape(item[1]) not in self.reference.said
        )
        tracks = track_of(stage.collector), self.reference.track
        found = outcome_of(self.fault.name, stage.feed.run, span, tracks, next(told, None))
        expected = int((self.reference.track.time <= span.until).sum())
        return replace(
            found,
            crash=crash,
            lost=max(expected - found.samples, 0),
            surprises=_surprises(stage.bus.errors),
        )


def _surprises(errors: Sequence[str]) -> tuple[str, ...]:
    """Return what was logged of exceptions that no code had foreseen."""
    found = (shape(text) for text in errors if UNFORESEEN.search(text))
    return tuple(dict.fromkeys(found))[:SURPRISES]


@contextmanager
def unchanged(folder: Path | None) -> Iterator[None]:
    """Put the files of a folder back, in the end, as they were."""
    if folder is None:
        yield
        return
    before = {path: path.read_bytes() for path in folder.iterdir()}
    yield
    for path in folder.iterdir():
        path.unlink()
    for path, content in before.items():
        path.write_bytes(content)
