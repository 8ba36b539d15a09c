"""Trials within one process: a run that is played to fresh nodes, with one fault in it.

All faults of a run share what comes before them: the run is played once, and where a fault begins
a process is forked off that plays the rest with it."""

import gc
import multiprocessing
import re
import shutil
import signal
import tempfile
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

from isogal_ros.faults.catalogue import Fault, Moment, topics_of
from isogal_ros.faults.judgement import Row, Span, outcome_of
from isogal_ros.faults.stage import Feed, Stage, without_numbers

LIMIT = 120.0
"""s of wall time after which a trial hangs."""
UNEXPECTED = re.compile(r": \w*(Error|Exception|Warning): ")
"""In what a node logs of an exception (`GraphNode.guard`)."""
MOST_ERRORS = 20
"""Kept of a trial."""
RECOVERY, LOOKED_AT = 2.0 / 9.0, 1.0 / 6.0
"""Shares of a run's duration: after a fault it has so long to recover, and is looked at for so
long then."""
TURN = 20.0
"""s that a slow node takes nothing, and then goes."""
_FORK = multiprocessing.get_context("fork")


def run_trials(feed: Feed, faults: Sequence[Fault]) -> Iterator[Row]:
    """Play a run, and yield what became of each fault, by the time it begins."""
    with tempfile.TemporaryDirectory(prefix="isogal-faults-") as folder:
        # checkpoints take time, and only nodes that are killed need them
        killing = any(isinstance(fault.effect, str) for fault in faults)
        stage = Stage(feed, Path(folder) if killing else None)
        drawn = [(*feed.begin_of(fault.name), fault) for fault in faults]
        for begin, rng, fault in sorted(drawn, key=lambda item: item[0]):
            stage.play(begin - 1e-9)
            with _unchanged(Path(folder)):
                yield _Trial(stage, fault, begin, rng).forked()


@contextmanager
def _unchanged(folder: Path) -> Iterator[None]:
    """Put a folder back, in the end, as it was."""
    with tempfile.TemporaryDirectory() as copy:
        shutil.copytree(folder, copy, dirs_exist_ok=True)
        yield
        shutil.rmtree(folder)
        shutil.copytree(copy, folder)


class _Trial:
    """The rest of a run, from where a stage is, with a fault that begins now."""

    def __init__(self, stage: Stage, fault: Fault, begin: float, rng: np.random.Generator) -> None:
        self._stage, self._fault, self._begin = stage, fault, begin
        duration, end = stage.feed.duration, begin + fault.lasts + 1.0
        after = end + RECOVERY * duration
        self._span = Span(begin, end, after, after + LOOKED_AT * duration)
        topics = topics_of(fault.targets[0], stage.recorded.readings)
        self._types = {topic.name: topic.type for topic in topics}
        self._moment = Moment(0.0, rng, {})
        self._acts = False

    def forked(self) -> Row:
        """Play it in a process of its own; return what became of it."""
        gc.freeze()
        receiving, sending = _FORK.Pipe(duplex=False)
        child = _FORK.Process(target=self._play, args=(sending,))
        try:
            child.start()
            sending.close()
            if receiving.poll(LIMIT):
                return receiving.recv()
            crash = f"nothing came within {LIMIT:g} s"
        except EOFError:
            crash = "the process ended"
        finally:
            if child.pid is not None:
                child.kill()
                child.join()
        return self._outcome(crash)

    def _play(self, sending: Any) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends with the parent's trial
        stage, crash = self._stage, None
        stage.bus.change = self._change
        try:
            stage.play(self._span.until, self._act)
        except Exception:
            crash = traceback.format_exc(limit=-3)
        sending.send(self._outcome(crash))

    def _change(self, topic: str, data: bytes) -> list[bytes]:
        """Return what comes instead of a serialised message."""
        fault, self._moment.since = self._fault, self._stage.bus.now - self._begin
        if topic not in self._types or not fault.is_on(self._moment.since):
            return [data]
        assert callable(fault.effect)
        message = deserialize_message(data, self._types[topic])
        return [serialize_message(one) for one in fault.effect(message, self._moment)]

    def _act(self, now: float) -> None:
        """Let the fault of nodes begin and end."""
        stage, effect = self._stage, self._fault.effect
        if callable(effect) or self._acts == self._fault.is_on(now - self._begin, TURN):
            return
        self._acts = not self._acts
        for name in self._fault.targets:
            if effect in ("killed", "begun anew"):
                if self._acts:
                    stage.kill(name)
                else:
                    stage.start(name, () if effect == "killed" else ("checkpoint",))
            elif self._acts:
                stage.bus.stop(stage.nodes[name])
            else:
                stage.bus.go(stage.nodes[name])

    def _outcome(self, crash: str | None) -> Row:
        stage, feed = self._stage, self._stage.feed
        reports = (
            (time, text)
            for time, text in stage.reports
            if time >= self._begin and without_numbers(text) not in feed.reports
        )
        found = outcome_of(self._fault, feed, self._span, stage.collector, reports, crash)
        errors = (without_numbers(text) for text in stage.bus.errors if UNEXPECTED.search(text))
        return found | {"unexpected_errors": list(dict.fromkeys(errors))[:MOST_ERRORS]}
