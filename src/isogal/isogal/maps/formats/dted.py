"""Terrain heights in DTED cells (MIL-PRF-89020B), ``.dt0``, ``.dt1`` and ``.dt2``: metres above
the geoid, read as GDAL reads them."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from isogal.maps.formats.format import Asked, FileGrid, file_format
from isogal.maps.formats.geotiff import open_raster


@contextmanager
def _open(path: Path, asked: Asked) -> Iterator[FileGrid]:
    with open_raster(path, asked, "DTED") as grid:
        yield replace(grid, quantity="height", unit="m")


FORMAT = file_format("dted", (".dt0", ".dt1", ".dt2"), _open)
