"""What a trial is played on: a run without fault, and fresh nodes that its sensors are played
to."""

import math
import re
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rclpy.serialization import deserialize_message

from isogal.earth.frames import horizontal_difference
from isogal.scenario import Scenario
from isogal.seeds import generator
from isogal_ros import topics
from isogal_ros.bags.collect import Collector
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.in_process import run_in_process
from isogal_ros.graph.plan import Plan
from isogal_ros.graph.player import TICK, Player
from isogal_ros.graph.recorded import load
from isogal_ros.messages.position import read_position
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.nodes.signals import Interrupt


class Track(NamedTuple):
    """The navigator's horizontal error and 1-sigma (N,), m, at times (N,), s."""

    time: np.ndarray
    error: np.ndarray
    sigma: np.ndarray
    not_finite: int
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
        with tempfile.TemporaryDirectory() as folder:
            bag = Path(folder) / "bag"
            plan = Plan(scenario, bag, run=run)
            run_in_process(
                plan, Interrupt() if interrupt is None else interrupt, lambda progress: None
            )
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


class Stage(Player):
    """Fresh nodes that a run is played to, and when they report something.

    Parameters
    ----------
    feed : Feed
        What is played to them.
    checkpoints : path, optional
        Folder of their checkpoints; None = they write none.
    """

    def __init__(self, feed: Feed, checkpoints: Path | None = None) -> None:
        self.feed = feed
        self.reports: list[tuple[float, str]] = []
        """When (s) something was reported at WARN or ERROR, and what."""
        own: dict[str, Any] = {"diagnostics_period": 2.0 * TICK}
        if checkpoints is not None:
            own["checkpoint"] = str(checkpoints)
        super().__init__(replace(feed.recorded, scenario=feed.scenario), own, {})

    def take(self, topic: topics.Topic, data: bytes) -> None:
        """Keep a message, and when it reports something."""
        known = len(self.collector.said)
        super().take(topic, data)
        self.reports += [(self.bus.now, text) for _, text in self.collector.warnings[known:]]

    def kill(self, name: str) -> None:
        """Take a node off, as if its process had been killed."""
        self.bus.remove(self.nodes.pop(name))

    def play(
        self, until: float = math.inf, before_step: Callable[[float], None] | None = None
    ) -> "Stage":
        """Play what is still to be played up to a time (s), and call something with the time
        before each step; return itself."""
        for ns in self.stamps():
            if to_seconds(ns) > until:
                break
            if before_step is not None:
                before_step(to_seconds(ns))
            self.step(ns)
        return self


def without_numbers(text: str) -> str:
    """Return a report or an error without its numbers."""
    return re.sub(r"[0-9.]+", "", text)
