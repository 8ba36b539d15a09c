"""Candidate positions on the iso-value contours of a batch's readings, at sub-cell precision."""

import math

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import value_and_gradient
from isogal.matching.interfaces import Batch, Candidates

_LATTICE = np.stack(
    np.meshgrid(np.linspace(-2.0, 2.0, 4), np.linspace(-2.0, 2.0, 4)), axis=-1
).reshape(-1, 2)
"""(16, 2) seeds in posterior 1-sigmas."""


def contour_candidates(
    batch: Batch, field_map: FieldMap, mean: Array, covariance: Array, steps: int = 3
) -> Candidates:
    """Return where round each scan's estimated position the map has the reading's value.

    From a lattice of seeds in the posterior's 2-sigma ellipse, Newton steps along the gradient
    lead onto the contour (docs/mathematics.md, section 7.5); a candidate's weight is the posterior
    density there, normalised within its scan.

    Parameters
    ----------
    mean, covariance : (4,), (4, 4) arrays
        Posterior of the navigator's error at the batch end.
    """
    scans = np.flatnonzero(np.isfinite(batch.reading))
    scans = scans[scans >= len(batch) - batch.new]
    transition = batch.transition[scans]
    centre = transition @ mean
    spread = transition @ covariance @ transition.transpose(0, 2, 1)
    root = np.linalg.cholesky(spread + 1e-6 * np.eye(2))
    north, east = metres_per_radian(batch.latitude[scans])
    # (scans, seeds, 2) navigator's error, m
    position = centre[:, None] + _LATTICE @ root.transpose(0, 2, 1)
    level = (batch.reading - batch.offset - batch.reading_jacobian @ mean)[scans]
    limit = 2.0 * np.sqrt(np.trace(spread, axis1=1, axis2=2))
    place = np.stack([batch.latitude[scans], batch.longitude[scans], 1.0 / north, 1.0 / east], 1)
    _follow(field_map.grid, place, level, limit, steps, position)
    whitened = np.linalg.solve(root[:, None], (position - centre[:, None])[..., None])[..., 0]
    distance = (whitened**2).sum(axis=-1)
    weight = np.exp(-0.5 * distance) * (distance < 25.0)
    weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    keep = weight > 1e-6
    latitude = batch.latitude[scans, None] - position[..., 0] / north[:, None]
    longitude = batch.longitude[scans, None] - position[..., 1] / east[:, None]
    scan = np.broadcast_to(scans[:, None], keep.shape)
    return Candidates(latitude[keep], longitude[keep], weight[keep], scan[keep].astype(np.int64))


@kernel
def _follow(grid, place, level, limit, steps, position):  # type: ignore[no-untyped-def]
    """Move positions (N, S, 2), m, of the navigator's error onto the contours of N levels, where
    it believes to be at (N, 4): latitude and longitude, rad, and their radians per metre. No step
    is longer than a limit (N,) to the north or to the east."""
    for t in range(position.shape[0]):
        lat, lon, by_north, by_east = place[t]
        for s in range(position.shape[1]):
            for _ in range(steps):
                north, east = position[t, s]
                value, north_slope, east_slope = value_and_gradient(
                    grid, lat - north * by_north, lon - east * by_east, 0
                )
                north_slope, east_slope = north_slope * by_north, east_slope * by_east
                step = (level[t] - value) / max(north_slope**2 + east_slope**2, 1e-30)
                if not math.isfinite(step):
                    break
                position[t, s, 0] -= min(max(step * north_slope, -limit[t]), limit[t])
                position[t, s, 1] -= min(max(step * east_slope, -limit[t]), limit[t])
