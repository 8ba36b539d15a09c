"""Made-up but realistic records for the tests of evaluation."""

from typing import Any

import numpy as np
import pytest

from helpers.studies import outcomes
from isogal.evaluation.records import RunDetail, Runs


def _make(runs=3, states=121, step=60.0, batches=24, scale=50.0, seed=1, detail=False, **changes):
    """Errors of a navigator that knows its own covariance (scale² on either axis), and an unaided
    one that drifts."""
    random = np.random.default_rng(seed)
    time = np.arange(states) * step
    covariance = np.broadcast_to(scale**2 * np.eye(2), (runs, states, 2, 2))
    fix_covariance = np.broadcast_to((1.5 * scale) ** 2 * np.eye(2), (runs, batches, 2, 2)).copy()
    values: dict[str, Any] = {
        "time": time,
        "latitude": np.radians(np.linspace(-38.0, -37.0, states)),
        "longitude": np.radians(np.linspace(144.5, 146.0, states)),
        "error": scale * random.standard_normal((runs, states, 2)),
        "covariance": covariance,
        "unaided_error": scale
        * (1 + time[None, :, None] / 600.0)
        * random.standard_normal((runs, 1, 2)),
        "fix_time": np.linspace(time[0], time[-1], batches + 1)[1:],
        "fix_error": 1.5 * scale * random.standard_normal((runs, batches, 2)),
        "fix_covariance": fix_covariance,
        **outcomes(np.full((runs, batches), "")),
        "posterior_error": scale * random.standard_normal((runs, batches, 2)),
        "posterior_covariance": np.broadcast_to(scale**2 * np.eye(2), (runs, batches, 2, 2)),
        "fix_seconds": random.uniform(1e-3, 3e-3, (runs, batches)),
    }
    if detail:
        scans, candidates = 10 * batches, 15 * batches
        signal = 9.8 + 3e-4 * np.sin(np.linspace(0.0, 20.0, scans))
        batch = np.repeat(np.arange(batches), 15)
        at = np.searchsorted(time, values["fix_time"][batch]).clip(0, states - 1)
        values["detail"] = RunDetail(
            scan_time=np.linspace(time[0], time[-1], scans + 1)[1:],
            reading=signal + 2e-5 * random.standard_normal(scans),
            map_value=signal,
            map_value_navigator=signal + 1e-5 * random.standard_normal(scans),
            candidate_latitude=values["latitude"][at] + 1e-4 * random.standard_normal(candidates),
            candidate_longitude=values["longitude"][at]
            + 1e-4 * random.standard_normal(candidates),
            candidate_weight=random.uniform(0.0, 1.0, candidates),
            candidate_batch=batch,
        )
    return Runs(**(values | changes))


@pytest.fixture(scope="session")
def make_runs():
    """The factory of made-up records."""
    return _make
