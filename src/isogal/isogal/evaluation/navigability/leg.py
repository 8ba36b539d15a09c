"""A straight leg that ends at a place: what the navigator's error along it can be, before any
reading counts.

It is the linear error model of the bound (`isogal.evaluation.bound`), whose states at all
readings are one large Gaussian vector. Over a leg of some minutes few combinations of them matter:
position, velocity and acceleration errors. The vector is written as B c with coefficients c of
variance one, B from the largest eigenvalues of its covariance. B does not depend on the map and
hardly on the place, so that it is computed once for each heading."""

import math

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.bound import bias_and_drift, linear_model, propagated
from isogal.evaluation.navigability.kernels import Approach, Leg
from isogal.evaluation.reading_errors import effective_noise_variance
from isogal.fields.measured import measured_field
from isogal.scenario import Route, Settings, Truth
from isogal.sensors.trajectory import Trajectory, build_trajectory

MOST = 10
"""Coefficients at most."""
_NEGLECTED = 1e-5
"""Share of the variance that may be left out."""


def leg_to(
    truth: Truth, latitude: float, longitude: float, heading: float, quantisation: float
) -> Leg:
    """Return the leg that ends at a place.

    Parameters
    ----------
    truth : Truth
        Its speed, height, interval of readings, sensors and initial errors count, and the batch
        length as the number of readings, or `route.duration` where that is shorter.
    latitude, longitude, heading : float
        rad.
    quantisation : float
        Step of the map's values.
    """
    straight = leg_route(truth, latitude, longitude, heading)
    truth = truth.model_copy(update={"route": straight})
    trajectory = build_trajectory(truth)
    stride = truth.steps_per_scan
    scans = np.arange(stride, len(trajectory) + 1, stride)
    stacked = _covariance(truth, trajectory)
    T = len(scans)
    north, east = metres_per_radian(latitude, trajectory.height[-1])
    end = scans[-1]
    places = np.stack([trajectory.latitude, trajectory.longitude], axis=1)
    offset = (places[scans] - places[end]) * (north, east)
    jacobian = measured_field(truth).reduction(truth).jacobian(trajectory.at(scans))
    basis = _basis(stacked, jacobian)
    rest = np.trace(stacked[-5:-3, -5:-3]) - (basis[-1, :2] ** 2).sum()
    approach = Approach(
        offset,
        float(np.hypot(*trajectory.velocity[end, :2])) * truth.gravimeter.interval,
        effective_noise_variance(truth.gravimeter, quantisation),
        np.ascontiguousarray(jacobian[:, :2].mean(axis=0)),
    )
    return Leg(
        approach,
        np.ascontiguousarray(basis[:, :2]),
        np.einsum("ti,tim->tm", np.column_stack([jacobian, np.ones(T)]), basis),
        max(float(rest), 0.0),
    )


def leg_route(settings: Settings, latitude: float, longitude: float, heading: float) -> Route:
    """Return a straight route.

    Parameters
    ----------
    settings : Settings
        How fast, how high and how long; see `leg_to`.
    latitude, longitude : float
        Where it ends, rad.
    heading : float
        rad.
    """
    route, interval = settings.route, settings.gravimeter.interval
    count = settings.matcher.batch_length
    if route.duration is not None:
        count = min(count, int(route.duration / interval + 1e-9))
    duration = max(count, 1) * interval
    length = duration * route.speed
    north, east = metres_per_radian(latitude, route.height)

    def ahead(metres: float) -> tuple[float, float]:
        return (
            math.degrees(latitude + metres * math.cos(heading) / float(north)),
            math.degrees(longitude + metres * math.sin(heading) / float(east)),
        )

    # the end lies a little beyond the place, so that the vehicle is there at the last reading
    ends = {"start": ahead(-length), "end": ahead(0.05 * length)}
    return route.model_copy(update={**ends, "waypoints": None, "duration": duration})


def _covariance(truth: Truth, trajectory: Trajectory) -> Array:
    """Return (5 T, 5 T) the covariance of position, velocity (north, east) and of the readings'
    offset at all readings."""
    model = linear_model(truth, trajectory)
    P, per_scan = model.start, model.segments.per_scan
    crosses, rows = np.zeros((0, len(P))), []
    for stretch, (transition, *noise) in enumerate(model.transitions(), 1):
        P = propagated(P, transition, *noise)
        crosses = crosses @ transition.T
        if stretch % per_scan == 0:
            crosses = np.concatenate([crosses, P[:4]])
            rows.append(crosses[:, :4])
    T = len(rows)
    elapsed = np.arange(1, T + 1) * per_scan * model.segments.dt
    bias, drift = bias_and_drift(truth.gravimeter, truth.map_error, trajectory)
    stacked = np.zeros((T, 5, T, 5))
    stacked[:, 4, :, 4] = bias**2 + drift**2 * np.outer(elapsed, elapsed)
    for k, row in enumerate(rows):
        stacked[: k + 1, :4, k, :4] = row.reshape(k + 1, 4, 4)
    upper = np.triu(stacked.reshape(5 * T, 5 * T))
    return upper + np.triu(upper, 1).T


def _basis(stacked: Array, jacobian: Array) -> Array:
    """Return B (T, 5, m): what is largest in position, and in what a reading gets from velocity
    and offset."""
    T = len(jacobian)
    size = np.tile(np.sqrt(np.diag(stacked).reshape(T, 5).max(axis=0)), T)
    scale = np.where(size > 0.0, 1.0 / np.maximum(size, 1e-150), 0.0)
    values, vectors = np.linalg.eigh(stacked * np.outer(scale, scale))
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    kept = int(np.searchsorted(np.cumsum(values), (1.0 - _NEGLECTED) * values.sum())) + 1
    kept = min(kept, MOST, len(values))
    basis = size[:, None] * vectors[:, :kept] * np.sqrt(values[:kept])
    return np.ascontiguousarray(basis.reshape(T, 5, kept))
