"""Sensors of height and velocity in the bound: how readings depend on the errors of the linear
model and on the auxiliary states."""

from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Integers
from isogal.evaluation.ins_error_model import Segments
from isogal.fields.measured import measured_field
from isogal.fusion.aiding import velocity_reading
from isogal.fusion.model import FilterModel
from isogal.inertial.error_model import STATES
from isogal.inertial.error_state import FILTER_STATES
from isogal.scenario import Scenario
from isogal.sensors.reduction import State
from isogal.sensors.trajectory import Trajectory

_OF_FILTER = [*range(2), 3, 4, *range(6, FILTER_STATES)]
"""The linear model's states among the filter's: without height and vertical velocity."""


class AidsModel(NamedTuple):
    """What the bound's recursion needs of the aids."""

    by_height: Array
    """(S, M) d(reading)/d(auxiliary state) of the mapped field, by the height that it is reduced
    with, at S scans."""
    velocity: Array
    """(K, A, 13 + M) d(velocity reading)/d(error) at the ends of K stretches; A = 0 = no aid."""
    noise: float
    """m²/s², variance of a velocity reading, or of the mean of those of a stretch."""
    every: int
    """Stretches from one velocity reading to the next."""


def aids_model(
    scenario: Scenario, model: FilterModel, segments: Segments, slope: Array, height: Array
) -> AidsModel:
    """Return the model of a scenario's aids.

    Parameters
    ----------
    scenario : Scenario
        As it really is.
    model : FilterModel
        Of it.
    slope, height : (S,) arrays
        d(reading)/d(height) of the mapped field, map's unit per m, and the height, m, at scans.
    """
    reading, settings = model.height_reading, scenario.velocity
    by_height = slope[:, None] * (reading.offset + reading.share * height[:, None])
    stretches, states = len(segments.geometry), STATES + len(model.auxiliary)
    if settings.kind == "none":
        return AidsModel(by_height, np.zeros((stretches, 0, states)), 1.0, 1)
    rows = np.empty((stretches, len(settings.axes), states))
    columns = [*_OF_FILTER, *range(FILTER_STATES, model.states)]
    for k, (geometry, rotation) in enumerate(
        zip(segments.geometry, segments.rotation, strict=True)
    ):
        past = np.array([geometry[1], geometry[2], 0.0])
        rows[k] = velocity_reading(model, rotation, past, {})[0][list(settings.axes)][:, columns]
    every = max(1, round(settings.interval / segments.dt))
    mean_of = max(1.0, segments.dt / settings.interval)
    return AidsModel(by_height, rows, settings.number("sigma") ** 2 / mean_of, every)


def height_slope(scenario: Scenario, trajectory: Trajectory, scans: Integers) -> Array:
    """Return (S,) d(reading)/d(height) at scans, indices into a trajectory; map's unit per m."""
    latitude, longitude, height = (
        values[scans] for values in (trajectory.latitude, trajectory.longitude, trajectory.height)
    )
    at = State(latitude, longitude, height, *trajectory.velocity[scans, :2].T)
    return np.asarray(measured_field(scenario).reduction(scenario).height_slope(at))
