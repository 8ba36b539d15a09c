"""Navigability as a file: NetCDF, or GeoTIFF with a band for each layer."""

from functools import partial
from pathlib import Path

import numpy as np

from isogal.evaluation.navigability.area import Navigability
from isogal.files import atomic_path


def write_navigability(found: Navigability, path: Path) -> None:
    """Write all layers, as GeoTIFF where the name ends so; raises InputError where the file cannot
    be written."""
    write = _geotiff if path.suffix.casefold() in (".tif", ".tiff") else _netcdf
    with atomic_path(path) as temporary:
        write(found, temporary)


def _netcdf(found: Navigability, path: Path) -> None:
    import netCDF4

    with netCDF4.Dataset(str(path), "w") as dataset:
        dataset.Conventions = "CF-1.8"
        dataset.title = "navigability"
        dataset.unaided_error_m = found.prior
        axes = (
            ("lat", found.latitude, "latitude", "degrees_north"),
            ("lon", found.longitude, "longitude", "degrees_east"),
            ("heading", found.heading, "heading, clockwise from north", "degree"),
        )
        for name, axis, text, unit in axes:
            dataset.createDimension(name, axis.size)
            coordinate = dataset.createVariable(name, "f8", (name,))
            coordinate.long_name, coordinate.units = text, unit
            coordinate[:] = np.degrees(axis)
        packed = partial(
            dataset.createVariable, datatype="f4", zlib=True, complevel=4, fill_value=np.nan
        )
        for name, (grid, unit, text) in found.layers().items():
            layer = packed(name, dimensions=("lat", "lon"))
            layer.units, layer.long_name = unit.replace("m/s²", "m s-2"), text
            layer[:] = grid
        error = packed("error", dimensions=("heading", "lat", "lon"))
        error.units, error.long_name = "m", "RMS horizontal error on arrival by heading"
        error[:] = found.error


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
