"""Map files in every format and arrangement, written without the library's code where it can, and
what is said of one that is refused."""

from itertools import zip_longest
from types import SimpleNamespace

import netCDF4
import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from isogal.errors import InputError
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.load import load_map

STEP = 0.05
"""deg, between nodes of the small map."""
ARRANGEMENT = {
    "order": ("lat", "lon"),
    "flip": (),
    "names": {"lat": "lat", "lon": "lon", "z": "dg"},
    "turn": 0.0,
    "pack": None,
    "radians": False,
    "extra": (),
    "layout": "NETCDF4",
}
"""Of a NetCDF file."""
BAND = {"unit": "mGal", "name": "dg", "nodata": None, "scale": None, "kind": "float64", "bands": 1}
"""Of a GeoTIFF."""
HEADER = {
    "generating_institute": "test",
    "modelname": "NONE",
    "functional": "gravity_disturbance",
    "unit": "mgal",
    "gapvalue": "9999.0",
    "latlimit_north": "-36.05",
    "latlimit_south": "-37.0",
    "longlimit_west": "144.5",
    "longlimit_east": "145.65",
    "gridstep": "0.05",
    "number_of_gridpoints": "480",
}
"""Of an ICGEM grid of the small map."""


def refused(path, *asked, **options):
    """What is said of a map that cannot be read, one line."""
    with pytest.raises(InputError) as error:
        load_map(path, *asked, **options)
    assert "\n" not in str(error.value)
    return str(error.value)


def axes(dataset, latitude, longitude, names=("lat", "lon")):
    """Write the axes of a NetCDF file, deg."""
    units = "degrees_north", "degrees_east"
    for name, unit, nodes in zip(names, units, (latitude, longitude), strict=True):
        dataset.createDimension(name, nodes.size)
        axis = dataset.createVariable(name, "f8", (name,))
        axis.units, axis[:] = unit, nodes


def netcdf(path, field_map, units="m s-2", **changes):
    """Write a map in some arrangement; other changes are attributes of the variable."""
    how = SimpleNamespace(**{key: changes.pop(key, usual) for key, usual in ARRANGEMENT.items()})
    lat, lon = np.degrees(field_map.latitude), np.degrees(field_map.longitude) + how.turn
    nodes, values = {"lat": lat, "lon": lon}, field_map.values
    for index, key in enumerate(nodes):
        if key in how.flip:
            nodes[key], values = nodes[key][::-1], np.flip(values, index)
    with netCDF4.Dataset(path, "w", format=how.layout) as dataset:
        dataset.title = "a title of odd length"
        for key in how.extra:
            dataset.createDimension(key, 1)
        axes(dataset, *nodes.values(), (how.names["lat"], how.names["lon"]))
        if how.radians:
            for key, name in (("lat", "latitude"), ("lon", "longitude")):
                variable = dataset[how.names[key]]
                variable.units, variable.standard_name = "radians", name
                variable[:] = np.radians(nodes[key])
        dims = (*how.extra, *(how.names[key] for key in how.order))
        packed = {"datatype": "i2", "fill_value": -32768} if how.pack else {"datatype": "f8"}
        data = dataset.createVariable(how.names["z"], dimensions=dims, **packed)
        if how.pack:
            data.scale_factor, data.add_offset = how.pack
        if units:
            data.units = units
        data.setncatts(changes)
        data[:] = (values if how.order == ("lat", "lon") else values.T)[(None,) * len(how.extra)]
    return path


def together(path, *maps, names=()):
    """Write maps of the same nodes to one file, as variables of some names or of their
    quantities."""
    for one, name in zip_longest(maps, names):
        part = path.with_suffix(".part")
        write_netcdf(one, part, name)
        if one is maps[0]:
            part.rename(path)
            continue
        with netCDF4.Dataset(path, "a") as dataset, netCDF4.Dataset(part) as more:
            for key in more.variables.keys() - dataset.variables.keys():
                added = dataset.createVariable(key, "f8", ("lat", "lon"), fill_value=np.nan)
                attributes = vars(more[key])
                added.setncatts({key: attributes[key] for key in attributes if key[0] != "_"})
                added[:] = more[key][:]
    return path


def geotiff(path, values, transform, crs="EPSG:4326", **changes):
    """Write rows from the north, as GeoTIFFs are."""
    how = SimpleNamespace(**BAND | changes)
    bands = range(1, how.bands + 1)
    shape = {"height": values.shape[0], "width": values.shape[1], "count": how.bands}
    kind = {"dtype": how.kind, "nodata": how.nodata}
    with rasterio.open(
        path, "w", driver="GTiff", crs=crs, transform=transform, **shape, **kind
    ) as out:
        for band in bands:
            out.write(values.astype(how.kind), band)
        if how.unit:
            out.units = (how.unit,) * how.bands
        if how.name:
            out.descriptions = tuple(f"{how.name} {b}" if b > 1 else how.name for b in bands)
        if how.scale:
            out.scales, out.offsets = ((one,) * how.bands for one in how.scale)
    return path


def table(field_map, order="lon lat value", mark=" ", extra=""):
    """Rows of text from the north, mGal; with another column in between."""
    lat, lon = np.degrees(field_map.latitude), np.degrees(field_map.longitude)
    rows = []
    for i in reversed(range(lat.size)):
        for j in range(lon.size):
            value = {"lat": lat[i], "lon": lon[j], "value": 1e5 * field_map.values[i, j]}
            words = [f"{value[name]:.10f}" for name in order.split()]
            rows.append(mark.join([*words[:2], *([extra] if extra else []), *words[2:]]))
    return "\n".join(rows) + "\n"


def gdf(body, drop=(), **changes):
    """An ICGEM grid of rows; with other values in the header, or without some of it."""
    header = HEADER | changes
    lines = [f"{key:24s} {value}" for key, value in header.items() if key not in drop]
    names = "\n\n  longitude  latitude  gravity_disturbance\n  [deg.]  [deg.]  [mgal]\n"
    return "\n".join(lines) + names + "end_of_head " + "=" * 30 + "\n" + body


def save(path, text):
    """Write text."""
    path.write_text(text, encoding="utf-8")
    return path


def _tiff(path, field_map):
    half = 0.5 * STEP
    north, west = np.degrees(field_map.latitude[-1]) + half, np.degrees(field_map.longitude[0])
    transform = from_origin(west - half, north, STEP, STEP)
    geotiff(path, 1e5 * field_map.values[::-1], transform, kind="float32")


WRITERS = {
    "map.nc": netcdf,
    "old.nc": lambda path, field_map: netcdf(path, field_map, layout="NETCDF3_CLASSIC"),
    "map.tif": _tiff,
    "map.gdf": lambda path, field_map: save(path, gdf(table(field_map))),
    "map.xyz": lambda path, field_map: save(path, "lon lat dg[mGal]\n" + table(field_map)),
}
"""Of the small map, by names of files."""
