"""Faults of processes: who is meant, and what is done to them."""

import signal

import pytest

from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.faults import trials
from isogal_ros.faults.catalogue import PROCESS_FAULTS, Fault
from isogal_ros.faults.trials import Signals


class Process:
    """Notes the signals that it gets."""

    def __init__(self) -> None:
        self.signals: list[int] = []

    def poll(self) -> None:
        return None

    def send_signal(self, number: int) -> None:
        self.signals.append(number)


class Some:
    """Stands for the processes of a run."""

    def __init__(self) -> None:
        self.running = {name: Process() for name in (RECORDER, *topics.NODES)}


@pytest.fixture
def clock(monkeypatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(trials.time, "monotonic", lambda: now[0])
    return now


def test_every_node_is_killed_stopped_and_slow() -> None:
    for effect in ("killed", "stopped", "slow"):
        alone = {f.targets for f in PROCESS_FAULTS if f.effect == effect and len(f.targets) == 1}
        assert alone == {(name,) for name in (RECORDER, *topics.NODES)}


def test_a_kill_comes_once_and_at_its_time(clock) -> None:
    pair = (topics.PMHT_MM, topics.UKF_FUSION)
    some, inject = Some(), Signals(Fault("x", pair, "killed", 1.0), 50.0)
    for simulated in (-1.0, 49.0, 50.0, 51.0):
        inject(some, simulated)
        assert bool(inject.begun_ns) == (simulated >= 50.0)
    clock[0] += 2.0
    inject(some, 60.0)  # a process that was killed may be another by now
    assert inject.over
    got = {name for name, process in some.running.items() if signal.SIGKILL in process.signals}
    assert got == set(pair)
    assert sum(process.signals.count(signal.SIGKILL) for process in some.running.values()) == 2


@pytest.mark.parametrize(("effect", "stops"), [("stopped", 1), ("slow", 15)])
def test_a_stop_ends(clock, effect, stops) -> None:
    fault = Fault("x", (topics.GRAVIMETER,), effect, 3.0)
    some, inject = Some(), Signals(fault, 50.0)
    for _ in range(100):
        inject(some, 60.0)
        clock[0] += 0.05
    got = some.running[topics.GRAVIMETER].signals
    assert got.count(signal.SIGSTOP) == stops
    assert got[-1] == signal.SIGCONT
