"""Maps into GGMplus tiles."""

import math
from pathlib import Path

import numpy as np

from isogal.errors import InputError
from isogal.files import atomic_path, make_folder
from isogal.maps.field_map import FieldMap
from isogal.maps.ggmplus.tiles import CELLS, KINDS, STEP_DEG, tile_name, tiles_of


def write_ggmplus(field_map: FieldMap, folder: str | Path) -> list[Path]:
    """Write a map as GGMplus tiles; cells that it has no value at are no-data.

    Parameters
    ----------
    field_map : FieldMap
        The map; it is interpolated to the cells of GGMplus.
    folder : path
        Made if it is not there; tiles in it are replaced.

    Returns
    -------
    list of Path
        The tiles.

    Raises
    ------
    InputError
        GGMplus has no such quantity, a number does not fit, or the folder cannot be written.
    """
    fitting = [e for e, kind in KINDS.items() if kind.quantity == field_map.quantity]
    if not fitting:
        raise InputError(
            f"{folder}: GGMplus has no {field_map.quantity} files; it has {', '.join(KINDS)}"
        )
    kind, folder = KINDS[fitting[0]], Path(folder)
    make_folder(folder)
    paths = []
    for south, west in tiles_of(field_map.extent):
        centres = np.radians(STEP_DEG * (np.arange(CELLS) + 0.5))
        latitude = math.radians(south) + centres
        raw = np.full((CELLS, CELLS), kind.no_data, dtype=kind.dtype)
        for column, longitude in enumerate(math.radians(west) + centres):
            numbers = np.rint(field_map.value(latitude, longitude) / kind.step)
            known = np.isfinite(numbers)
            if (np.abs(numbers[known]) > np.iinfo(kind.dtype).max).any():
                raise InputError(
                    f"{folder}: a value does not fit into {kind.dtype} steps of {kind.step:g}"
                )
            raw[column, known] = numbers[known]
        if (raw != kind.no_data).any():
            paths.append(folder / tile_name(south, west, fitting[0]))
            with atomic_path(paths[-1]) as temporary:
                raw.tofile(temporary)
    return paths
