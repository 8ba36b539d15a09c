"""Batches of readings of several channels, such as the components of the
gravity gradient tensor.

Rows of a batch are scans times channels. A row names its channel, the map of that channel predicts
it (`isogal.maps.channels`), and the channels of a scan may have correlated noise. Everything else
a matcher does with a batch stays as it is for one channel.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.channels import ChannelMap, channels_of
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch
from isogal.matching.reading_noise import scan_noise


def channel_batch(batch: Batch, readings: ArrayLike, covariance: ArrayLike) -> Batch:
    """Return a batch with several readings at each scan.

    Parameters
    ----------
    batch : Batch
        Of one channel: stamps, positions, transition and prior are taken over; its readings, sigma
        and offset are not. What the navigator's error does to readings by their reduction is not
        known for other channels, and taken as nothing.
    readings : (T, C) array
        Unit of the maps; NaN = no reading of that channel at that scan.
    covariance : (C, C) or (T, C, C) array
        Of the sensor's noise, positive definite.

    Raises
    ------
    InputError
        Shapes that do not fit, or a covariance that is not positive definite.
    """
    readings = np.asarray(readings, dtype=np.float64)
    if readings.ndim != 2 or readings.shape[0] != len(batch):
        raise InputError(
            f"readings of several channels must have shape ({len(batch)}, channels),"
            f" have {readings.shape}"
        )
    scans, channels = readings.shape
    blocks = _of_each_scan(np.asarray(covariance, dtype=np.float64), scans, channels)
    white, common = scan_noise(blocks)
    rows = batch.part(np.repeat(np.arange(scans), channels))
    apart = rows.reading_apart
    return replace(
        rows,
        reading=readings.reshape(-1),
        sigma=white,
        reading_by_error=np.zeros_like(rows.reading_by_error),
        reading_apart=None if apart is None else np.zeros_like(apart),
        new=batch.new * channels,
        reading_rate=None,
        channel=np.tile(np.arange(channels), scans),
        parameters=common,
    )


def _of_each_scan(covariance: Array, scans: int, channels: int) -> Array:
    """Return the covariance (T, C, C) of each scan's readings from that or one for all of them,
    (C, C); raises InputError as `channel_batch`."""
    if covariance.shape not in ((channels, channels), (scans, channels, channels)):
        raise InputError(
            f"covariance of readings of several channels must have shape ({channels}, {channels})"
            f" or with {scans} scans in front, has {covariance.shape}"
        )
    blocks = np.broadcast_to(covariance, (scans, channels, channels))
    if not (
        np.isfinite(blocks).all()
        and (np.linalg.eigvalsh(0.5 * (blocks + blocks.swapaxes(1, 2))) > 0.0).all()
    ):
        raise InputError("covariance of readings of several channels must be positive definite")
    return np.asarray(0.5 * (blocks + blocks.swapaxes(1, 2)))


def first_channel(batch: Batch, field_map: FieldMap | ChannelMap) -> tuple[Batch, FieldMap]:
    """Return the part of a batch that belongs to the first map or beam, and that map; a batch of
    one as it is.

    For what is shown of a batch: candidates on contours, the map's variability.
    """
    first = channels_of(field_map)[0]
    each = batch.channel if batch.beam is None else batch.beam
    if each is None:
        return batch, first
    rows = np.flatnonzero(each == 0)
    new = int((rows >= len(batch) - batch.new).sum())
    part = replace(
        batch.part(rows),
        new=new,
        channel=None,
        beam=None,
        parameters=None,
        of_one_potential=None,
    )
    return part, first
