"""A navigator beside which others are measured: it takes all readings as measurements that are
linear about the truth, and is told the errors of map and instrument.

Its model is that of the bound (`isogal.evaluation.bound`), so that its mean squared error is the
bound's; with the same inertial data and readings it has the same chance in it as the navigator
that it is compared with, and the ratio of both is known from a few runs."""

import math

import closed_loop  # first: it asks NumPy for one thread
import numpy as np

from isogal.afterwards import readings_of
from isogal.arrays import Array
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.relinearised import navigated
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.maps.several import RunMap, each_map
from isogal.navigator import Navigator
from isogal.scenario import Scenario
from isogal.sensors.trajectory import Trajectory

NEAR = 1.0
"""m, 1-sigma of a place over which a map is linear: its derivative at the truth."""


def linear_navigator(
    scenario: Scenario, trajectory: Trajectory, maps: RunMap, navigator: Navigator
) -> InertialNavigator | None:
    """Return it at the end of the voyage of a navigator with the whole history; None where
    readings have errors that it does not model."""
    world = scenario.true.informed
    errors = {
        "map_sigma": world.map_error.sigma,
        "map_correlation_length_m": world.map_error.correlation_length,
    }
    readings = readings_of(world, each_map(maps), navigator.sensed, errors)
    if readings is None:
        return None
    time = np.unique(np.concatenate([one.time for one in readings]))
    model, truth = navigator.inertial.model, []
    for k in np.searchsorted(trajectory.time, time - 1e-6).tolist():
        place = trajectory.latitude[k], trajectory.longitude[k], trajectory.height[k]
        estimate = Estimate(np.array(place), trajectory.velocity[k], trajectory.attitude[k])
        state = FilterState.start(estimate, model)
        state.covariance[:2, :2] = np.eye(2) * NEAR**2
        truth.append(state)
    return navigated(navigator.inertial, readings, time, truth)


def paired(squared: Array, linear: Array) -> closed_loop.Figures:
    """Return `linear`, the RMS error of linear navigators, and the ratio to it, `paired`, of the
    first as many of some others, with its standard error `paired_error`; NaN where there are none.

    Parameters
    ----------
    squared, linear : (R,) and (L,) arrays
        Mean squared error of each run, m²; R >= L.
    """
    if len(linear) == 0:
        return dict.fromkeys(("linear", "paired", "paired_error"), math.nan)
    ratio, error = closed_loop.jackknife(
        lambda one, other: math.sqrt(one.mean() / other.mean()), squared[: len(linear)], linear
    )
    return {"linear": math.sqrt(linear.mean()), "paired": ratio, "paired_error": error}
