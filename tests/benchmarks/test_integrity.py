"""`benchmarks/integrity.py`: parts are taken, made and counted once."""

from concurrent.futures import ThreadPoolExecutor

import closed_loop
import integrity
import numpy as np
import pytest

from helpers.studies import outcomes
from isogal.evaluation.integrity import RISKS
from isogal.evaluation.records import Runs
from isogal.scenario import Integrity, Scenario

STATES = 361


def part(runs: int) -> Runs:
    """Runs of an hour whose navigator claims 50 m; the first is 1 km off for ten minutes."""
    error = np.zeros((runs, STATES, 2))
    error[0, 100:160, 1] = 1000.0
    covariance = np.broadcast_to(np.diag([50.0**2, 25.0**2]), (runs, STATES, 2, 2))
    empty = np.empty((runs, 0))
    return Runs(
        time=np.arange(STATES) * 10.0,
        latitude=np.zeros(STATES),
        longitude=np.zeros(STATES),
        error=error,
        covariance=covariance,
        unaided_error=error,
        fix_time=np.empty(0),
        fix_error=np.empty((runs, 0, 2)),
        fix_covariance=np.empty((runs, 0, 2, 2)),
        **outcomes(np.empty((runs, 0))),
        posterior_error=np.empty((runs, 0, 2)),
        posterior_covariance=np.empty((runs, 0, 2, 2)),
        fix_seconds=empty,
    )


def test_parts_that_are_there_are_counted(tmp_path, monkeypatch):
    for runs, path in closed_loop.parts_of(Scenario(), 12, tmp_path / "parts"):
        part(len(runs)).save(path)
    monkeypatch.setattr(closed_loop, "simulate", lambda *_: pytest.fail("is to compute nothing"))
    with ThreadPoolExecutor(1) as pool:
        parts = list(integrity.parts_of(Scenario(), 12, tmp_path, pool))
    counts = [integrity.Count.of(one, Integrity()) for one in parts]
    assert sum(one.hours for one in counts) == pytest.approx(12.0)
    assert {risk: sum(one.events[risk] for one in counts) for risk in RISKS} == dict.fromkeys(
        RISKS, 2
    )


def test_tails_are_found():
    """Of 40,000 values of a bivariate t of 20 degrees of freedom: the factor's sigma is 0.008, and
    that of 1 / freedom 0.003."""
    random = np.random.default_rng(2)
    squares = 1.2 * random.chisquare(2.0, 40_000) * 20.0 / random.chisquare(20.0, 40_000)
    factor, freedom = integrity.tails(squares)
    assert factor == pytest.approx(1.2, abs=0.03)
    assert 1.0 / freedom == pytest.approx(0.05, abs=0.012)
