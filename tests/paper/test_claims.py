"""Verdicts follow from the numbers: made-up outcomes, both ways."""

from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from isogal.paper.cases import AIDING, DEFAULT, PAPER, RIVAL, TABLES, UNAIDED, Plan
from isogal.paper.claims import (
    FAILS,
    HOLDS,
    OPEN,
    RULES,
    judge,
)
from isogal.paper.measure import AlongTrack, Outcome, Results, Tracks

TIME = np.arange(0.0, 12961.0, 60.0)
RUNS = 100


def outcome(setting, mean=100.0, diverged=0, spread=0.1, seed=0):
    """Runs whose errors scatter about a constant, beside a drift of 1 km in 3.6 h."""
    random = np.random.default_rng(seed)
    per_run = mean * (1.0 + spread * random.standard_normal(RUNS))
    error = per_run[:, None] * np.ones(TIME.size)
    drift = 1000.0 * (TIME / TIME[-1]) * np.abs(1.0 + 0.3 * random.standard_normal((RUNS, 1)))
    summary: dict[str, Any] = {
        "diverged": diverged,
        "nees_per_axis": {"mean": 3.0},
        "bound": {"rms": 50.0},
    }
    bound = np.full(TIME.size, 50.0)
    return Outcome(setting, summary, TIME, error, drift, bound, TIME[5::5], None)


def all_outcomes(change=lambda _: {}):
    settings = [*TABLES, *UNAIDED, RIVAL]
    return {setting: outcome(setting, **change(setting)) for setting in settings}


def results(outcomes, **changes):
    noise = np.random.default_rng(1).standard_normal((1, TIME.size, 2))
    rough, smooth = 20.0 * noise, np.cumsum(noise, axis=1)
    tracks = {s: Tracks(rough, smooth if s.mode == "retrodiction" else rough) for s in AIDING}
    variability = np.where(TIME <= 3600.0, 1e-10, 4e-10)
    values: dict[str, Any] = {
        "plan": Plan(RUNS, None, 12960.0),
        "outcomes": MappingProxyType(outcomes),
        "spreads": (),
        "tracks": tracks,
        "snapshots": (),
        "drift": {(3e-4, "precision"): 1380.0, (3e-4, "quantum_accelerometer"): 1379.0},
        "signal": {
            q: AlongTrack(TIME, np.sin(TIME / 500.0), variability, variability / 2e-10)
            for q in ("gravity", "disturbance")
        },
        "profile": None,
        "window": None,
    }
    return Results(**(values | changes))


class NoMap(Plan):
    """A plan whose maps tell the size of their cells and nothing else."""

    def field_map(self, setting):
        return type("Map", (), {"cell_size_m": staticmethod(lambda latitude: (222.0, 222.0))})()


def replace_plan(measured):
    example = type("Example", (), {"ambiguous": 0.5})()
    return replace(measured, plan=NoMap(RUNS, None, 12960.0), profile=example)


def verdict(key, measured):
    claim = RULES[key](measured)
    assert claim.measured.endswith(".")
    return claim.verdict


def test_every_claim_is_decided():
    judged = judge(replace_plan(results(all_outcomes())))
    assert [claim.key for claim in judged] == list(RULES)
    for claim in judged:
        assert claim.claim.endswith(".")
        assert claim.verdict in (HOLDS, FAILS, OPEN)


def trend(noise, short):
    """Errors that are so many times larger at high noise, and with T = 15."""

    def change(s):
        factors = noise if s.sigma > 1.5e-5 else 1, short if s.batch_length == 15 else 1
        return {"mean": 100.0 * factors[0] * factors[1]}

    return all_outcomes(change)


def means(mean, matcher=None):
    """Outcomes of a mean error, all or those of a matcher; 100 m else."""
    return all_outcomes(lambda s: {"mean": mean if matcher in (None, s.matcher) else 100.0})


def diverging(count, at_low_noise=0):
    return all_outcomes(lambda s: {"diverged": count if s.sigma > 1.5e-5 else at_low_noise})


def scattered():
    return all_outcomes(lambda s: {"seed": round(s.sigma * 1e6) + s.batch_length})


def twenty_runs():
    return {setting: replace(one, error=one.error[:20]) for setting, one in all_outcomes().items()}


def growing():
    """Aided errors that drift, unaided ones that do not."""
    return {
        setting: replace(one, error=one.unaided, unaided=np.full_like(one.unaided, 100.0))
        for setting, one in all_outcomes().items()
    }


VERDICTS = [
    (HOLDS, trend(5.0, 2.0), ("sensor", "shorter batches", "T and noise")),
    (FAILS, trend(0.2, 0.5), ("sensor", "shorter batches")),
    (OPEN, scattered(), ("sensor",)),
    (HOLDS, diverging(22), ("divergence by noise", "no divergence", "short batch suffices")),
    (FAILS, all_outcomes(), ("divergence by noise",)),  # 0 of 100 excludes even 6 %
    (OPEN, twenty_runs(), ("divergence by noise",)),
    (FAILS, diverging(10, 10), ("no divergence",)),
    (HOLDS, means(520.0), ("500 m",)),
    (FAILS, means(135.0), ("500 m",)),
    (HOLDS, means(520.0, PAPER), ("500 m",)),
    (FAILS, means(520.0, DEFAULT), ("500 m",)),
    (HOLDS, all_outcomes(), ("unbounded", "bounded", "retrodiction")),
    (FAILS, growing(), ("unbounded", "bounded")),
    (HOLDS, means(570.0), ("benefit",)),
    (FAILS, means(10.0), ("benefit",)),
    (HOLDS, means(400.0, "tercom"), ("little data",)),
    (FAILS, means(50.0, "tercom"), ("little data",)),
    (FAILS, all_outcomes(), ("first hour",)),
    (OPEN, all_outcomes(), ("drag",)),
]


@pytest.mark.parametrize(
    ("expected", "outcomes", "key"),
    [(expected, outcomes, key) for expected, outcomes, keys in VERDICTS for key in keys],
)
def test_verdicts(expected, outcomes, key):
    assert verdict(key, results(outcomes)) == expected
