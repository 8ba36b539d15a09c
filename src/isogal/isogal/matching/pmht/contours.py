"""Candidate positions on the iso-value contours of a batch's readings, at sub-cell precision."""

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.field_map import FieldMap
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
    level = (batch.reading - batch.offset - batch.reading_jacobian @ mean)[scans, None]
    limit = 2.0 * np.sqrt(np.trace(spread, axis1=1, axis2=2))[:, None, None]
    for _ in range(steps):
        latitude = batch.latitude[scans, None] - position[..., 0] / north[:, None]
        longitude = batch.longitude[scans, None] - position[..., 1] / east[:, None]
        value, d_north, d_east = field_map.value_and_gradient(latitude, longitude)
        slope = np.stack([d_north, d_east], axis=-1)
        square = np.maximum((slope**2).sum(axis=-1), 1e-30)
        move = ((level - value) / square)[..., None] * slope
        position = position - np.clip(np.nan_to_num(move), -limit, limit)
    whitened = np.linalg.solve(root[:, None], (position - centre[:, None])[..., None])[..., 0]
    distance = (whitened**2).sum(axis=-1)
    weight = np.exp(-0.5 * distance) * (distance < 25.0)
    weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    keep = weight > 1e-6
    latitude = batch.latitude[scans, None] - position[..., 0] / north[:, None]
    longitude = batch.longitude[scans, None] - position[..., 1] / east[:, None]
    scan = np.broadcast_to(scans[:, None], keep.shape)
    return Candidates(latitude[keep], longitude[keep], weight[keep], scan[keep].astype(np.int64))
