"""Maps into NetCDF files (CF-1.8)."""

from pathlib import Path
from typing import Any

import numpy as np

from isogal.errors import InputError
from isogal.files import atomic_path
from isogal.maps.error_ellipses import ELLIPSE_NAMES, axes_of
from isogal.maps.field_map import FieldMap

_CF_UNITS = {"m/s²": "m s-2", "1/s²": "s-2"}


def write_netcdf(field_map: FieldMap, path: str | Path, variable: str | None = None) -> None:
    """Write a map as CF-1.8 NetCDF, such that `read_netcdf` gives the same map back.

    Parameters
    ----------
    field_map : FieldMap
        The map.
    path : path
        File; appears only when complete.
    variable : str, optional
        Name of the variable; None = the quantity.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    try:
        with atomic_path(path) as temporary:
            _write(field_map, temporary, variable or field_map.quantity)
    except RuntimeError as error:  # what the C library raises, for example where the disk is full
        raise InputError(f"{path}: cannot be written: {error}") from None


def _write(field_map: FieldMap, path: Path, name: str) -> None:
    import netCDF4

    unit = _CF_UNITS.get(field_map.unit, field_map.unit)
    with netCDF4.Dataset(str(path), "w") as dataset:
        dataset.Conventions = "CF-1.8"
        dataset.title = f"{field_map.quantity} map"
        dataset.source = field_map.provenance
        for key, axis, text in (
            ("lat", field_map.latitude, "latitude"),
            ("lon", field_map.longitude, "longitude"),
        ):
            dataset.createDimension(key, axis.size)
            coordinate = dataset.createVariable(key, "f8", (key,))
            coordinate.standard_name = coordinate.long_name = text
            coordinate.units = "degrees_north" if key == "lat" else "degrees_east"
            coordinate[:] = np.degrees(axis)
        kwargs: dict[str, Any] = {
            "zlib": True,
            "complevel": 4,
            "fletcher32": True,
            "fill_value": np.nan,
        }
        data = dataset.createVariable(
            name, field_map.values.dtype.str[1:], ("lat", "lon"), **kwargs
        )
        data.units = unit
        _describe(data, field_map)
        data[:] = field_map.values
        if isinstance(field_map.sigma, float):
            data.error_sigma = field_map.sigma
        else:
            data.ancillary_variables = f"{name}_sigma"
            sigma = dataset.createVariable(f"{name}_sigma", "f8", ("lat", "lon"), **kwargs)
            sigma.units = unit
            sigma.long_name = f"1-sigma error of {name}"
            sigma[:] = field_map.sigma
        if field_map.correlation_lengths is not None:
            length = dataset.createVariable(f"{name}_error_length", "f4", ("lat", "lon"), **kwargs)
            length.units = "m"
            length.long_name = f"correlation length of the error of {name}"
            length[:] = field_map.correlation_lengths
        if field_map.error_ellipses is not None:
            *lengths, azimuth = axes_of(field_map.error_ellipses)
            for suffix, unit, axis in zip(
                ELLIPSE_NAMES, ("m", "m", "degrees"), (*lengths, np.degrees(azimuth)), strict=True
            ):
                part = dataset.createVariable(f"{name}_{suffix}", "f4", ("lat", "lon"), **kwargs)
                part.units = unit
                part.long_name = f"correlation of the error of {name}: {suffix}"
                part[:] = axis


def _describe(data: Any, field_map: FieldMap) -> None:
    """Write what is one number or word of the whole map."""
    data.long_name = field_map.quantity.replace("_", " ")
    data.isogal_quantity = field_map.quantity
    if field_map.quantisation:
        data.quantisation = field_map.quantisation
    if field_map.correlation_length is not None:
        data.error_correlation_length = field_map.correlation_length
    if field_map.height is not None:
        data.height_m = field_map.height
    if field_map.error_stated is not None:
        data.error_stated = int(field_map.error_stated)
