"""Faults of processes: who is meant, and what is done to them."""

import signal

import pytest

from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.faults import process_faults
from isogal_ros.faults.process_faults import PROCESS_FAULTS, Meddler, ProcessFault
from isogal_ros.nodes.signals import Interrupt


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
    monkeypatch.setattr(process_faults.time, "monotonic", lambda: now[0])
    return now


def test_every_node_is_killed_stopped_and_slow() -> None:
    for kind in ("kill", "stop", "slow"):
        alone = {f.nodes for f in PROCESS_FAULTS if f.kind == kind and len(f.nodes) == 1}
        assert alone == {(name,) for name in (RECORDER, *topics.NODES)}
    assert len({fault.name for fault in PROCESS_FAULTS}) == len(PROCESS_FAULTS)


def test_a_kill_comes_once_and_at_its_time(clock) -> None:
    pair = (topics.PMHT_MM, topics.UKF_FUSION)
    some, meddle = Some(), Meddler(ProcessFault("x", pair, "kill"), 50.0, Interrupt())
    for simulated in (-1.0, 49.0, 50.0, 51.0):
        meddle(some, simulated)
        assert bool(meddle.begun_ns) == (simulated >= 50.0)
    got = {name for name, process in some.running.items() if process.signals == [signal.SIGKILL]}
    assert got == set(pair)
    assert sum(len(process.signals) for process in some.running.values()) == 2


@pytest.mark.parametrize(("kind", "stops"), [("stop", 1), ("slow", 12)])
def test_a_stop_ends(clock, kind, stops) -> None:
    fault = ProcessFault("x", (topics.GRAVIMETER,), kind, 3.0)
    some, meddle = Some(), Meddler(fault, 50.0, Interrupt())
    for _ in range(60):
        meddle(some, 60.0)
        clock[0] += 0.125
    got = some.running[topics.GRAVIMETER].signals
    assert got.count(signal.SIGSTOP) == stops
    assert got[-1] == signal.SIGCONT


def test_a_run_that_hangs_is_ended(clock) -> None:
    interrupt = Interrupt()
    meddle = Meddler(PROCESS_FAULTS[0], 50.0, interrupt)
    meddle(Some(), 10.0)
    assert not interrupt
    clock[0] += process_faults.PATIENCE + 1.0
    meddle(Some(), 10.0)
    assert interrupt
    assert meddle.hung
