"""Batches of a recorded track: where they end, and what a matcher gets for each
(docs/mathematics.md, section 10.1)."""

import math
from dataclasses import replace

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.inertial.error_state import BATCH_STATES, level
from isogal.maps.channels import RouteMap
from isogal.matching.interfaces import Batch
from isogal.scenario import Matcher as MatcherSettings
from isogal.tracks.track import Track

FEWEST_IN_BATCH = 4
"""Scans that the incomplete last batch needs to be matched."""
_EDGE_REACH = ((2.0, 2.0 / 3.0), (1.0, 0.5))
"""Distance from a reading, in 1-sigmas of the prior, within which the map must have values all
round; and the share of the readings that must be left for that distance to be used."""


def between_batches(settings: MatcherSettings) -> int:
    """Return the readings from one batch end to the next: batches of a recorded track do not
    overlap unless the stride says so."""
    return settings.batch_length if settings.stride is None else settings.stride


def batch_ends(count: int, settings: MatcherSettings) -> list[int]:
    """Return after how many readings each batch ends.

    The last batch may be incomplete if it has `FEWEST_IN_BATCH` new readings, or if it is the only
    one."""
    ends = list(range(settings.batch_length, count + 1, between_batches(settings)))
    if count - (ends[-1] if ends else 0) >= FEWEST_IN_BATCH or not ends:
        ends.append(count)
    return ends


def build_batch(
    track: Track, jacobian: Array, rows: slice, new: int, error: Array, covariance: Array
) -> Batch:
    """Return rows of a track as a batch.

    Parameters
    ----------
    track : Track
    jacobian : (N, 4) array
        `Track.jacobian`.
    rows : slice
        Readings of the batch, earlier ones that the matcher wants as context included.
    new : int
        How many of the last rows no earlier batch has used.
    error : (4,) array
        Error of the track at the last row as far as it is known (north, east m; m/s): the batch is
        moved by it.
    covariance : (4, 4) array
        Of the error that remains.
    """
    time = track.time[rows]
    backward = np.tile(np.eye(BATCH_STATES), (time.size, 1, 1))
    backward[:, 0, 2] = backward[:, 1, 3] = time - time[-1]
    by_error = np.einsum("ti,tij->tj", jacobian[rows], backward[:, :4])
    north, east = metres_per_radian(track.latitude[rows])
    moved = backward[:, :2, :4] @ error
    return Batch(
        time=time,
        latitude=track.latitude[rows] - moved[:, 0] / north,
        longitude=track.longitude[rows] - moved[:, 1] / east,
        velocity=track.velocity[rows] - error[2:],
        reading=track.value[rows] - by_error[:, :4] @ error - track.offset[rows],
        sigma=track.sigma[rows],
        covariance=level(covariance),
        position_by_error=np.ascontiguousarray(backward[:, :2]),
        reading_by_error=by_error,
        backward=backward,
        new=min(new, time.size),
    )


def without_map_edge(batch: Batch, field_map: RouteMap) -> Batch:
    """Return the batch without the readings near which the map ends.

    A place off the map cannot be judged, and matchers take it as impossible: a reading whose true
    place may lie off the map would push the fix away from there. So readings without map all round
    them as far as the prior reaches are left out, as long as enough are left: two thirds of them
    for two 1-sigmas, half for one. Failing both, only readings off the map themselves are left
    out.
    """
    sigma = math.sqrt(float(np.linalg.eigvalsh(batch.prior[:2, :2])[-1]))
    new = np.arange(len(batch)) >= len(batch) - batch.new
    has = np.isfinite(batch.reading) & field_map.covers(batch.latitude, batch.longitude)
    north, east = metres_per_radian(batch.latitude)
    keep = has
    angle = np.arange(16)[:, None] * (np.pi / 8.0)
    for reach, share in _EDGE_REACH:
        inside = has.copy()
        for part in (0.5, 1.0):
            latitude = batch.latitude + part * reach * sigma * np.cos(angle) / north
            longitude = batch.longitude + part * reach * sigma * np.sin(angle) / east
            inside &= field_map.covers(latitude, longitude).all(axis=0)
        if (inside & new).sum() >= max(share * (has & new).sum(), FEWEST_IN_BATCH):
            keep = inside
            break
    return replace(batch, reading=np.where(keep, batch.reading, np.nan))
