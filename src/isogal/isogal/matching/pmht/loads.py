"""How large the map's error is at each reading, per unit of the states that stand for it."""

import numpy as np

from isogal.arrays import Array, Integers
from isogal.maps.channels import AnyMap, by_channel, channels_of
from isogal.maps.error_model import shares
from isogal.maps.field_map import FieldMap
from isogal.maps.roughness import roughness_at
from isogal.matching.interfaces import Batch


def loads_of(
    batch: Batch,
    which: Integers,
    field_map: AnyMap,
    errors: int,
    channel: Integers,
    rough: Array,
) -> Array:
    """Return `rows.Rows.load` (L, n, U): map errors in units of their own 1-sigmas, those of this
    scan's channels or beams first; what a grid leaves out is in proportion to how rough the map is
    there.

    Parameters
    ----------
    batch : Batch
    which : (n,) array of int
        Its rows.
    field_map : FieldMap or ChannelMap
    errors : int
        U.
    channel : (n,) array of int
        Of the rows.
    rough : (L,) array
        See `Models.shapes`.
    """
    maps = channels_of(field_map)
    place = batch.latitude[which], batch.longitude[which]
    own = by_channel(field_map, channel, FieldMap.sigma_at, *place)
    usual = np.array([stated_sigma(one) for one in maps])[channel]
    ratio = np.where(
        (usual > 0.0) & np.isfinite(own), own / np.where(usual > 0.0, usual, 1.0), 1.0
    )
    if batch.of_one_potential is not None:
        ratio = ratio * np.sqrt(shares(batch.of_one_potential))[channel]
    ratio = np.tile(ratio, (len(rough), 1))
    for k in np.flatnonzero(rough > 0.0):
        here = by_channel(field_map, channel, roughness_at, *place)
        ratio[k] = np.where(np.isfinite(here), here / rough[k], 1.0)
    load = np.zeros((len(rough), len(which), errors))
    load[:, np.arange(len(which)), channel if batch.beam is None else batch.beam[which]] = ratio
    return load


def stated_sigma(one: FieldMap) -> float:
    """Return the mean of what a map says of its own error (map's unit); 0 where it says nothing of
    the whole of it."""
    if one.error_stated is False:
        return 0.0
    sigma = np.asarray(one.sigma, dtype=np.float64)
    known = sigma[np.isfinite(sigma)]
    return float(known.mean()) if known.size else 0.0
