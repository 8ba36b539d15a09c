"""Exceedances of the protection level: how events are counted, and what is said of their rate."""

import math
from dataclasses import replace

import numpy as np
import pytest

from isogal.evaluation.integrity import (
    RISKS,
    Rate,
    correlation_time,
    excursions,
    integrity,
)
from isogal.evaluation.run_report import exceedance_table
from isogal.fusion.protection_level import protection_level
from isogal.scenario import Integrity

TIME = np.arange(12) * 10.0


@pytest.mark.parametrize(
    ("series", "events"),
    [
        ("............", 0),
        ("############", 1),
        ("..###...##..", 1),  # 40 s between them
        ("..#.....##..", 2),  # 60 s
        ("#....#....#.", 1),  # each 50 s after the one before
        ("#.....#....#", 2),
    ],
)
def test_events_are_stretches_that_are_well_apart(series, events):
    outside = np.array([[c == "#" for c in series]])
    assert excursions(outside, TIME, 50.0).tolist() == [events]


@pytest.mark.parametrize(
    ("events", "verdict"), [(0, "rarer"), (3, "rarer"), (10, "consistent"), (30, "more often")]
)
def test_verdicts(events, verdict):
    assert Rate(events, 100.0).verdict(0.1) == verdict


def test_the_figures_by_hand(make_runs):
    """Of runs of 6 h whose error is a little beyond the level at 0.1 per hour for half an hour in
    the middle of the second run, and nil elsewhere; one that is not known is outside."""
    runs = make_runs(states=361)
    error = np.zeros_like(runs.error)
    error[1, 100:130, 0] = 1.01 * protection_level(runs.covariance[0, 0], 0.1, 1000.0)
    found = integrity(replace(runs, error=error), Integrity(risk=1e-4))
    assert found["risk"] == 1e-4
    assert found["run_hours"] == pytest.approx(18.0)
    level = float(protection_level(50.0**2 * np.eye(2), 1e-4, 1000.0))
    assert found["level"]["median"] == pytest.approx(level)
    assert found["level"]["median_sigmas"] == pytest.approx(level / 50.0)
    assert [it["risk"] for it in found["exceedances"]] == [*RISKS, 1e-4]
    first = found["exceedances"][0]
    assert first["rate"] == pytest.approx(1.0 / 18.0)
    assert first["interval"] == pytest.approx([0.0253 / 18.0, 5.572 / 18.0], rel=1e-3)
    assert first["verdict"] == "consistent"
    assert [it["events"] for it in found["exceedances"]] == [1, 0, 0, 0]
    assert found["alert_limit"] is None
    error[0, -3:] = np.nan
    found = integrity(replace(runs, error=error), Integrity())
    assert [it["events"] for it in found["exceedances"]] == [2, 1, 1, 1]


def test_hazardous_is_an_error_beyond_the_limit_while_the_level_is_within(make_runs):
    runs = make_runs(runs=1, states=361)
    covariance = runs.covariance.copy()
    covariance[:, 200:] *= 100.0
    error = np.zeros_like(runs.error)
    error[0, [50, 300], 0] = 400.0, 1500.0
    runs = replace(runs, error=error, covariance=covariance)
    whole = integrity(runs, Integrity(alert_limit=350.0))
    found = whole["alert_limit"]
    what, events, *_ = exceedance_table(whole).rows[-1]
    assert (what, events) == ("error beyond 350 m, level within", "1")
    assert found["limit"] == 350.0
    assert found["available"] == pytest.approx(200 / 361)
    assert found["hazardous"]["events"] == 1


def test_the_correlation_time_is_measured(make_runs):
    """Gauss-Markov errors of 600 s in a turned ellipse, 4000 h: within 5 %, six of its sigmas."""
    states, step = 721, 20.0
    random = np.random.default_rng(3)
    keep = np.exp(-step / 600.0)
    white = random.standard_normal((1000, states, 2))
    white[:, 1:] *= np.sqrt(1.0 - keep**2)
    for k in range(1, states):
        white[:, k] += keep * white[:, k - 1]
    factor = np.array([[30.0, 0.0], [-20.0, 10.0]])
    covariance = np.broadcast_to(factor @ factor.T, (1000, states, 2, 2))
    error, time = white @ factor.T, np.arange(states) * step
    runs = make_runs(runs=1000, time=time, error=error, covariance=covariance)
    assert correlation_time(runs) == pytest.approx(600.0, rel=0.05)
    alternating = error * (-1.0) ** np.arange(states)[:, None]
    assert math.isnan(correlation_time(replace(runs, error=alternating)))
    short = replace(runs, time=time[:3], error=error[:, :3], covariance=covariance[:, :3])
    assert math.isnan(correlation_time(short))
