"""Maps from NetCDF files of the CF and GMT (COARDS) conventions.

Latitude and longitude may come in any order and direction, in degrees or radians, 0 to 360 or -180
to 180; values packed or not. What the file does not say (quantity, unit) is asked for."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from isogal.errors import InputError
from isogal.maps.assemble import assemble, check_size
from isogal.maps.axes import Window, part_within
from isogal.maps.error_ellipses import ELLIPSE_NAMES, ellipses_of
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.format import Format, by_suffix
from isogal.maps.formats.netcdf_classic import check_classic
from isogal.maps.formats.netcdf_variable import (
    HorizontalGrid,
    number_of,
    quantity_in,
    sigma_variable,
    step_of,
    text_of,
)
from isogal.maps.quantities import unit_factor


def read_netcdf(
    path: str | Path,
    variable: str | None = None,
    window: Window | None = None,
    *,
    quantity: str | None = None,
    unit: str | None = None,
) -> FieldMap:
    """Read one variable of a NetCDF file as a map.

    Parameters
    ----------
    path : path
        File.
    variable : str, optional
        Which variable; None = the one whose quantity is ``quantity``, or the only one whose
        quantity is known.
    window : Window, optional
        Only this part is read, with the nodes around it that interpolation needs.
    quantity, unit : str, optional
        Where the file does not say, or says it wrong.

    Raises
    ------
    InputError
        Not a NetCDF file, no such variable, axes or unit or quantity not said, impossible numbers,
        broken data.
    """
    import netCDF4

    where = str(path)
    if not Path(path).is_file():
        raise InputError(f"{where}: no such file")
    try:
        check_classic(Path(path), where)
        with netCDF4.Dataset(str(path)) as dataset:
            dataset.set_auto_maskandscale(False)
            return _read(dataset, variable, window, quantity, unit, where)
    except InputError:
        raise
    except (
        OSError,
        RuntimeError,
        ValueError,
        KeyError,
        IndexError,
        AttributeError,
        TypeError,
        MemoryError,
    ) as error:
        raise InputError(
            f"{where}: cannot be read as NetCDF:"
            f" {str(error).splitlines()[0] if str(error) else error!r}"
        ) from None


def _read(
    dataset: Any,
    name: str | None,
    window: Window | None,
    quantity: str | None,
    unit: str | None,
    where: str,
) -> FieldMap:
    name = _choose(dataset, name, quantity, where)
    data = dataset.variables[name]
    where = f"{where}:{name}"
    grid = HorizontalGrid.of(dataset, data, where)
    part = part_within(*grid.regular, window, where)
    check_size(math.prod(part.shape), where, window)
    unit = unit or text_of(data, "units")
    attributes: dict[str, Any] = {
        "quantisation": number_of(data, "quantisation") or step_of(data),
        "correlation_length": number_of(data, "error_correlation_length") or None,
        "height": number_of(data, "height_m"),
    }
    stated = number_of(data, "error_stated")
    attributes["error_stated"] = None if stated is None else stated != 0.0
    sigma: Any = number_of(data, "error_sigma") or 0.0
    lengths = dataset.variables.get(f"{data.name}_error_length")
    if lengths is not None and set(lengths.dimensions) == set(data.dimensions):
        attributes["correlation_lengths"] = grid.read(lengths, part)
    axes = [dataset.variables.get(f"{data.name}_{name}") for name in ELLIPSE_NAMES]
    if all(axis is not None and set(axis.dimensions) == set(data.dimensions) for axis in axes):
        longest, shortest, azimuth = (grid.read(axis, part) for axis in axes)
        attributes["error_ellipses"] = ellipses_of(longest, shortest, np.radians(azimuth))
    beside = sigma_variable(dataset, data)
    if beside is not None:
        sigma = grid.read(beside, part)
        if unit is not None:
            own_factor = unit_factor(text_of(beside, "units") or unit, where)[1]
            sigma = sigma * (own_factor / unit_factor(unit, where)[1])
    return assemble(
        grid.latitude[part.rows],
        part.longitude(grid.regular[1].step),
        grid.read(data, part),
        unit=unit,
        quantity=quantity or text_of(data, "isogal_quantity") or quantity_in(data),
        where=where,
        sigma=sigma,
        **attributes,
    )


def _choose(dataset: Any, name: str | None, quantity: str | None, where: str) -> str:
    grids = [
        key
        for key, item in dataset.variables.items()
        if item.ndim >= 2 and np.dtype(item.dtype).kind in "iuf"
    ]
    if name is not None:
        if name not in dataset.variables:
            raise InputError(
                f"{where}: has no variable '{name}'; it has"
                f" {', '.join(dataset.variables) or 'none'}"
            )
        if name not in grids:
            raise InputError(
                f"{where}: variable '{name}' is not a grid of numbers; grids:"
                f" {', '.join(grids) or 'none'}"
            )
        return name
    known = {
        key: text_of(data, "isogal_quantity") or quantity_in(data)
        for key, data in dataset.variables.items()
        if key in grids
    }
    fitting = [key for key in grids if known[key] is not None and quantity in (None, known[key])]
    if len(fitting) == 1:
        return fitting[0]
    if not fitting and len(grids) == 1 and (quantity is None or known[grids[0]] is None):
        return grids[0]
    if not grids and "x_range" in dataset.variables:
        raise InputError(
            f"{where}: is a grid of GMT 3 (values in one dimension); convert it with 'gmt"
            " grdconvert' first"
        )
    asked = f"for {quantity}" if quantity else "to use"
    raise InputError(
        f"{where}: does not say which variable {asked}; give variable= (--variable) one of"
        f" {', '.join(grids) or '(it has no grid)'}"
    )


FORMAT = Format("netcdf", by_suffix(".nc", ".nc4", ".grd", ".cdf"), read_netcdf)
