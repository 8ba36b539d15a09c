"""Maps into NetCDF files (CF-1.8)."""

from pathlib import Path

import numpy as np

from isogal.arrays import Values
from isogal.files import atomic_path
from isogal.maps.error_ellipses import ELLIPSE_NAMES, axes_of
from isogal.maps.field_map import FieldMap

Attributes = dict[str, str | float]
_CF_UNITS = {"m/s²": "m s-2", "1/s²": "s-2"}


def write_netcdf(field_map: FieldMap, path: str | Path, variable: str | None = None) -> None:
    """Write a map as CF-1.8 NetCDF, such that `load_map` gives the same map back.

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
    with atomic_path(path) as temporary:
        _write(field_map, temporary, variable or field_map.quantity)


def _write(field_map: FieldMap, path: Path, name: str) -> None:
    import netCDF4

    with netCDF4.Dataset(str(path), "w") as dataset:
        dataset.Conventions = "CF-1.8"
        dataset.title = f"{field_map.quantity} map"
        dataset.source = field_map.provenance
        for key, axis, text, unit in (
            ("lat", field_map.latitude, "latitude", "degrees_north"),
            ("lon", field_map.longitude, "longitude", "degrees_east"),
        ):
            dataset.createDimension(key, axis.size)
            coordinate = dataset.createVariable(key, "f8", (key,))
            coordinate.standard_name = coordinate.long_name = text
            coordinate.units = unit
            coordinate[:] = np.degrees(axis)
        for suffix, (values, attributes) in _variables(field_map, name).items():
            data = dataset.createVariable(
                name + suffix,
                values.dtype.str[1:],
                ("lat", "lon"),
                zlib=True,
                complevel=4,
                fletcher32=True,
                fill_value=np.nan,
            )
            data.setncatts(attributes)
            data[:] = values


def _variables(field_map: FieldMap, name: str) -> dict[str, tuple[Values, Attributes]]:
    """Return what is written at the nodes, by what follows the name of the variable."""
    unit = _CF_UNITS.get(field_map.unit, field_map.unit)
    said: dict[str, str | float | None] = {
        "units": unit,
        "long_name": field_map.quantity.replace("_", " "),
        "isogal_quantity": field_map.quantity,
        "quantisation": field_map.quantisation or None,
        "error_correlation_length": field_map.correlation_length,
        "error_unresolved": field_map.unresolved or None,
        "height_m": field_map.height,
        "error_stated": None if field_map.error_stated is None else int(field_map.error_stated),
    }
    found: dict[str, tuple[Values, Attributes]] = {}
    if isinstance(field_map.sigma, float):
        said["error_sigma"] = field_map.sigma
    else:
        said["ancillary_variables"] = f"{name}_sigma"
        found["_sigma"] = field_map.sigma, {"units": unit, "long_name": f"1-sigma error of {name}"}
    if field_map.error_ellipses is not None:
        *axes, azimuth = axes_of(field_map.error_ellipses)
        for suffix, of, axis in zip(
            ELLIPSE_NAMES, ("m", "m", "degrees"), (*axes, np.degrees(azimuth)), strict=True
        ):
            text = f"correlation of the error of {name}: {suffix}"
            found[f"_{suffix}"] = axis.astype(np.float32), {"units": of, "long_name": text}
    known = {key: value for key, value in said.items() if value is not None}
    return {"": (field_map.values, known), **found}
