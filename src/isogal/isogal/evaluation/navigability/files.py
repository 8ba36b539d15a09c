"""Navigability as a file: NetCDF, or GeoTIFF with a band for each layer."""

from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.evaluation.navigability.area import Navigability
from isogal.files import atomic_path

_Layer = tuple[tuple[str, ...], Array, str, str]
"""Dimensions, numbers, unit, description."""


def write_navigability(found: Navigability, path: Path) -> None:
    """Write all layers, as GeoTIFF where the name ends so; raises InputError where the file cannot
    be written."""
    write = _geotiff if path.suffix.casefold() in (".tif", ".tiff") else _netcdf
    try:
        with atomic_path(path) as temporary:
            write(found, temporary)
    except RuntimeError as error:  # what the libraries raise, for example where the disk is full
        raise InputError(f"{path}: cannot be written: {error}") from None


def _netcdf(found: Navigability, path: Path) -> None:
    import xarray

    axes = {
        "lat": (found.latitude, "latitude", "degrees_north"),
        "lon": (found.longitude, "longitude", "degrees_east"),
        "heading": (found.heading, "heading, clockwise from north", "degree"),
    }
    layers: dict[str, _Layer] = {
        name: (("lat", "lon"), *layer) for name, layer in found.layers().items()
    }
    text = "RMS horizontal error on arrival by heading"
    layers["error"] = ("heading", "lat", "lon"), found.error, "m", text
    dataset = xarray.Dataset(
        {
            name: (names, grid, {"units": unit.replace("m/s²", "m s-2"), "long_name": text})
            for name, (names, grid, unit, text) in layers.items()
        },
        {
            name: (name, np.degrees(axis), {"long_name": text, "units": unit})
            for name, (axis, text, unit) in axes.items()
        },
        {"Conventions": "CF-1.8", "title": "navigability", "unaided_error_m": found.prior},
    )
    packed = {"dtype": "f4", "zlib": True, "complevel": 4, "_FillValue": np.nan}
    dataset.to_netcdf(path, engine="netcdf4", encoding=dict.fromkeys(layers, packed))


def _geotiff(found: Navigability, path: Path) -> None:
    import rasterio

    latitude, longitude = np.degrees(found.latitude), np.degrees(found.longitude)
    width, height = (float(np.ptp(axis)) / (axis.size - 1) for axis in (longitude, latitude))
    west, north = longitude[0] - 0.5 * width, latitude[-1] + 0.5 * height
    corner = rasterio.Affine(width, 0.0, west, 0.0, -height, north)
    layers = found.layers()
    profile = {
        "driver": "GTiff",
        "width": longitude.size,
        "height": latitude.size,
        "count": len(layers),
        "dtype": "float32",
        "crs": "EPSG:4326",
        "transform": corner,
        "nodata": np.nan,
        "compress": "deflate",
    }
    with rasterio.open(path, "w", **profile) as dataset:
        for band, (name, (grid, unit, text)) in enumerate(layers.items(), 1):
            dataset.write(grid[::-1].astype(np.float32), band)
            dataset.set_band_description(band, name)
            dataset.update_tags(band, long_name=text)
            dataset.set_band_unit(band, unit)
