"""Tiles of the synthetic map: made once, in a process of their own, and kept in the user's cache
folder. Several processes may ask for them at once, and damaged ones are made again."""

import functools
import logging
import os
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from isogal.errors import InputError
from isogal.files import atomic_path
from isogal.maps.cache import cache_folder, locked
from isogal.maps.ggmplus.tiles import Tile, corner_of, tile_name
from isogal.maps.synthetic.terrain import make_tile

VERSION = 1
"""Part of the cache's folder name: raise it whenever a number of `terrain` changes."""
Progress = Callable[[int, int], None]
"""Called with (tiles ready, tiles needed)."""
Numbers = NDArray[np.int32]
_LOG = logging.getLogger(__name__)


def read_tiles(
    quantity: str, tiles: Iterable[Tile], progress: Progress | None = None
) -> Iterator[tuple[Tile, Numbers]]:
    """Give the numbers (500, 500) of tiles, in the quantity's `QUANTA`; make those that are not
    there."""
    needed = list(tiles)
    absent = [tile for tile in needed if _kept(tile, quantity) is None]
    for done in _made_in_child(absent):
        if progress is not None:
            progress(len(needed) - len(absent) + done, len(needed))
    for tile in needed:
        yield tile, _made(tile, quantity)


def _path(tile: Tile) -> Path:
    return cache_folder() / f"synthetic-{VERSION}" / tile_name(*tile, "npz")


def _kept(tile: Tile, quantity: str) -> Numbers | None:
    """Return the numbers of a tile, or None if its file is absent, cut short or damaged."""
    try:
        with np.load(_path(tile)) as file:
            return np.asarray(file[quantity])  # its checksum is compared as it is read
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
        return None


def _made(tile: Tile, quantity: str) -> Numbers:
    """Return the numbers of a tile, which is made if it is absent or damaged; not kept where the
    folder cannot be written."""
    if (found := _kept(tile, quantity)) is not None:
        return found
    path, arrays = _path(tile), None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with locked(path, wait=True):  # until another process that is making it has finished
            if (found := _kept(tile, quantity)) is not None:
                return found
            arrays = make_tile(*tile)
            with atomic_path(path) as temporary:
                np.savez(temporary, **arrays)  # type: ignore[arg-type]
    except (OSError, InputError) as error:
        _say_not_kept(path.parent, str(error))
    return (arrays or make_tile(*tile))[quantity]


@functools.cache  # once
def _say_not_kept(folder: Path, why: str) -> None:
    _LOG.warning("isogal: the cache %s cannot be written (%s): goes on without", folder, why)


def _made_in_child(tiles: list[Tile]) -> Iterator[int]:
    """Make tiles in another process, so that this one never takes the memory that it needs (70 MB,
    most of it never given back).

    Gives the number of tiles made. What the other process did not make, for whatever reason,
    `_made` makes here."""
    if not tiles:
        return
    command = [sys.executable, "-m", __spec__.name, *(_path(tile).name for tile in tiles)]
    try:
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as child:
            assert child.stdout is not None
            try:
                yield from (done for done, _ in enumerate(child.stdout, start=1))
            except BaseException:
                child.terminate()
                raise
    except OSError:
        return


if __name__ == "__main__":
    # each process in another order, so that they share the work
    for name in sorted(sys.argv[1:], key=lambda name: hash((os.getpid(), name))):
        _made(corner_of(name), "gravity")
        print(name, flush=True)
