"""Small files of the kinds that the pages of documentation take for granted.

page_data.py geotiff FILE.nc FILE.tif
page_data.py surveys FOLDER
page_data.py kalgoorlie kalgoorlie_gravity_magnetic.nc FILE.nc
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import rasterio
from netCDF4 import Dataset
from rasterio.transform import from_origin

from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.load import load_map

CORNER, SIDE = (-36.6, 147.0), 0.1
"""deg, of the square that is surveyed."""


def geotiff(source: str, path: str) -> None:
    """Write a map as a GeoTIFF in mGal that does not say what it is."""
    field_map = load_map(source)
    latitude, longitude = np.degrees(field_map.latitude), np.degrees(field_map.longitude)
    step = latitude[1] - latitude[0], longitude[1] - longitude[0]
    corner = longitude[0] - 0.5 * step[1], latitude[-1] + 0.5 * step[0]
    shape = {"height": len(latitude), "width": len(longitude), "count": 1, "dtype": "float64"}
    place = {"crs": "EPSG:4326", "transform": from_origin(*corner, step[1], step[0])}
    with rasterio.open(path, "w", driver="GTiff", **shape, **place) as file:
        file.write(field_map.values[::-1] * 1e5, 1)


def kalgoorlie(source: str, path: str) -> None:
    """Copy maps of the Bouguer anomaly, taken for the disturbance, and of the magnetic one."""
    bouguer = load_map(source, variable="bouguer_anomaly")
    write_netcdf(replace(bouguer, quantity="disturbance"), Path(path))
    magnetic = load_map(source, variable="magnetic_anomaly")
    with Dataset(path, "a") as file:
        (kept,) = (name for name, one in file.variables.items() if one.ndim == 2)
        file.renameVariable(kept, "gravity_disturbance")
        place = file["gravity_disturbance"].dimensions
        added = file.createVariable("magnetic_anomaly", "f8", place)
        added[:] = magnetic.values
        added.units = "nT"


def surveys(folder: str) -> None:
    """Write readings at stations, along flight lines with ties, and of several heights."""
    random, place = np.random.default_rng(0), Path(folder)
    steps = np.linspace(0.0, SIDE, 21)
    lines = [(steps, np.full(21, across)) for across in np.linspace(0.0, SIDE, 11)]
    ties = [(steps + 3e-4, across + 3e-4) for _, across in lines[::5]]
    along = [*lines, *((across, steps) for steps, across in ties)]
    north, east = np.concatenate(along, axis=1) + np.array(CORNER)[:, None]
    values = 20.0 * np.sin(150.0 * (north + 0.7 * east)) + 15.0 * np.cos(120.0 * (north - east))
    values += 0.1 * random.standard_normal(len(values))
    names = "latitude,longitude,disturbance"
    rows = np.column_stack([north, east, values])
    np.savetxt(place / "stations.csv", rows, "%.6f", ",", header=names, comments="")
    with (place / "survey.xyz").open("w") as file:
        print("/ latitude longitude disturbance", file=file)
        for number, part in enumerate(rows.reshape(-1, 21, 3)):
            print("Line" if number < len(lines) else "Tie", 10 * (number + 1), file=file)
            np.savetxt(file, part, "%.6f")
    with Dataset(place / "readings.nc", "w") as file:
        file.createDimension("reading", len(rows))
        columns = *rows.T, 300.0 + 100.0 * random.random(len(rows))
        units = "degrees_north", "degrees_east", "mGal", "m"
        for name, column, unit in zip((*names.split(","), "height"), columns, units, strict=True):
            variable = file.createVariable(name, "f8", ("reading",))
            variable[:] = column
            variable.units = unit


if __name__ == "__main__":
    {"geotiff": geotiff, "kalgoorlie": kalgoorlie, "surveys": surveys}[sys.argv[1]](*sys.argv[2:])
