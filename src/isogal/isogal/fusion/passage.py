"""What has become of a navigator's error between two times, from a clone of the first."""

import numpy as np

from isogal.arrays import Array
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import BATCH, BATCH_STATES, FILTER_NAMES
from isogal.passage import Passage

SLOW = (
    *((f"accelerometer_{axis}", f"accelerometer_in_run_{axis}") for axis in "xy"),
    *((f"gyroscope_{axis}", f"gyroscope_in_run_{axis}") for axis in "xyz"),
    ("gyroscope_scale_zz",),
    ("velocity_scale",),
    ("velocity_yaw",),
)
"""Sums of states that tilt the navigator, turn its heading or stretch its path: biases of the
horizontal accelerometers (m/s²) and the gyroscopes (rad/s), the vertical gyroscope's scale factor,
the velocity aid's scale factor and its yaw (rad)."""


def passage_of(
    since: float, first: FilterState, last: FilterState, rows: Array, jump: Array
) -> Passage:
    """Return what has become of the error since a time (s), from the state there and the newest
    one, which has a clone of the first, of `rows` (n, N), and by what satellites have moved the
    estimate (7,) that this one does not know."""
    slow, clone = rows[BATCH_STATES:, 9:], last.clone
    before = rows @ first.covariance @ rows.T
    return Passage(
        since,
        before,
        -clone.shift,
        before + clone.change,
        clone.cross @ rows.T,
        rows @ last.covariance @ rows.T,
        first.velocity[:2].copy(),
        np.array([slow @ np.concatenate(one.nominal[3:]) for one in (first, last)]),
        jump,
    )


def rows_of(model: FilterModel) -> Array:
    """Return (n, N) the states of a passage per unit of the filter's."""
    places = {name: k for k, name in enumerate(FILTER_NAMES)} | model.places
    rows = [np.eye(model.states)[k] for k in BATCH]
    for names in SLOW if model.slow_errors else ():
        row = np.zeros(model.states)
        row[[places[name] for name in names if name in places]] = 1.0
        rows.append(row)
    return np.array([row for row in rows if row.any()])
