"""Tiles of the synthetic map: made once, in a process of their own, and kept in the user's cache
folder."""

import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from isogal.maps.cache import Maker, cache_folder, read_array, read_or_make
from isogal.maps.ggmplus.tiles import Tile, corner_of, tile_name
from isogal.maps.synthetic.terrain import make_tile

VERSION = 1
"""Part of the cache's folder name: raise it whenever a number of `terrain` changes."""
Progress = Callable[[int, int], None]
"""Called with (tiles ready, tiles needed)."""


def read_tiles(
    quantity: str, tiles: Iterable[Tile], progress: Progress | None = None
) -> Iterator[tuple[Tile, NDArray[np.int32]]]:
    """Give the numbers (500, 500) of tiles, in the quantity's `QUANTA`, in any order; make those
    that are not there."""
    makers = _makers(tiles)
    absent = [path for path in makers if read_array(path, quantity) is None]
    for done in _made_in_child(absent):
        if progress is not None:
            progress(len(makers) - len(absent) + done, len(makers))
    for path, numbers in read_or_make(makers, quantity):
        yield corner_of(path.name), numbers


def _makers(tiles: Iterable[Tile]) -> dict[Path, Maker]:
    """Return the files of tiles, and what makes each."""
    return {_path(tile): partial(make_tile, *tile) for tile in tiles}


def _path(tile: Tile) -> Path:
    return cache_folder() / f"synthetic-{VERSION}" / tile_name(*tile, "npz")


def _made_in_child(paths: list[Path]) -> Iterator[int]:
    """Make tiles in another process, so that this one never takes the memory that it needs (70 MB,
    most of it never given back).

    Gives the number of tiles made. What the other process did not make, for whatever reason,
    `read_or_make` makes here."""
    if not paths:
        return
    command = [sys.executable, "-m", __spec__.name, *(path.name for path in paths)]
    try:
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as child:
            assert child.stdout is not None
            try:
                for done, _ in enumerate(child.stdout, start=1):
                    yield done
            except BaseException:
                child.terminate()
                raise
    except OSError:
        return


def _make_here(names: list[str]) -> None:
    """Make tiles; print the name of each when it is there."""
    for path, _ in read_or_make(_makers(map(corner_of, names)), "gravity"):
        print(path.name, flush=True)


if __name__ == "__main__":
    _make_here(sys.argv[1:])
