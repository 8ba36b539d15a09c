"""A large grid that is empty (NaN) but for a strip along a route, and takes memory for the strip
only.

The grid is an ordinary (n, m) float64 array for all who read it. Pages that hold nothing of the
strip are mapped, privately and many times over, from one small file of NaN; the system spends
memory on them only when they are touched."""

import contextlib
import ctypes
import mmap
import os
import tempfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.axes import Track

Spans = Integers
_NAN_BYTES = 1 << 20
_MOST_ROWS = 20_000  # each row may cost two mappings, and Linux allows 65530 a process


def row_spans(track: Track, latitude: Array, longitude: Array) -> Spans:
    """Return for each row of a grid the columns within the margin of a track, as (n, 2): first,
    and one after the last.

    Rows that the track does not come near have an empty span. ``longitude`` is continuous with the
    track's up to whole circles."""
    n, m = latitude.size, longitude.size
    spans = np.stack([np.full(n, m), np.zeros(n)], axis=1).astype(np.int64)
    north, _ = metres_per_radian(0.5 * (latitude[0] + latitude[-1]))
    points = thinned(track, float(north))
    reach = 1.05 * track.margin / float(north)  # the points are a tenth of the margin apart
    turn = 2.0 * np.pi * np.round((points[:, 1].mean() - longitude.mean()) / (2.0 * np.pi))
    dlat, dlon = latitude[1] - latitude[0], longitude[1] - longitude[0]
    for lat, lon in points:
        sideways = reach / max(np.cos(min(abs(lat) + reach, 1.55)), 0.02)
        rows = slice(
            max(int((lat - reach - latitude[0]) / dlat) - 2, 0),
            max(int((lat + reach - latitude[0]) / dlat) + 4, 0),
        )
        x = (lon - turn - longitude[0]) / dlon
        first, last = int(x - sideways / dlon) - 2, int(x + sideways / dlon) + 4
        np.minimum(spans[rows, 0], max(first, 0), out=spans[rows, 0])
        np.maximum(spans[rows, 1], min(max(last, 0), m), out=spans[rows, 1])
    spans[spans[:, 0] >= spans[:, 1]] = 0
    return spans


def thinned(track: Track, north: float) -> Array:
    """Return points (K, 2) along the track a tenth of the margin apart or less."""
    spacing = 0.1 * track.margin / north
    steps = np.maximum(np.abs(np.diff(track.latitude)), np.abs(np.diff(track.longitude)))
    along = np.r_[0.0, np.cumsum(steps)]
    at = np.linspace(0.0, along[-1], int(along[-1] / spacing) + 2)
    return np.stack(
        [np.interp(at, along, track.latitude), np.interp(at, along, track.longitude)], axis=1
    )


def strip_grid(rows: int, columns: int, spans: Spans) -> Array:
    """Return an array (rows, columns) full of NaN that has memory for the spans of `row_spans`
    only."""
    if rows > _MOST_ROWS or os.name != "posix":
        return np.full((rows, columns), np.nan)
    size = max(rows * columns * 8, 1)
    base = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    if hasattr(mmap, "MADV_NOHUGEPAGE"):  # a huge page would take 2 MB for each row touched
        with contextlib.suppress(OSError):
            base.madvise(mmap.MADV_NOHUGEPAGE)
    grid = np.frombuffer(base, dtype=np.float64, count=rows * columns).reshape(rows, columns)
    cells = mmap.PAGESIZE // 8
    flat = grid.reshape(-1)
    starts = np.arange(rows) * columns
    full = spans[:, 1] > spans[:, 0]
    low, high = (
        ((starts + spans[:, 0])[full] // cells) * cells,
        -(-(starts + spans[:, 1])[full] // cells) * cells,
    )
    with _nan_file() as descriptor:
        at = 0
        for first, last in zip(
            [*low.tolist(), flat.size], [*high.tolist(), flat.size], strict=True
        ):
            gap_end = first if first < flat.size else -(-flat.size // cells) * cells
            if gap_end > at:
                _map_nan(flat.ctypes.data + 8 * at, 8 * (gap_end - at), descriptor)
            flat[max(first, at) : last] = np.nan
            at = max(at, last)
    return grid


def pack(grid: NDArray[Any], spans: Spans) -> Array:
    """Return what a grid has within the spans, row after row, as one flat array."""
    return np.concatenate(
        [grid[row, first:last] for row, (first, last) in enumerate(spans.tolist())]
    )


def unpack(numbers: Array, rows: int, columns: int, spans: Spans) -> Array:
    """Return the `strip_grid` (rows, columns) of which `pack` has made the numbers."""
    grid = strip_grid(rows, columns, spans)
    at = 0
    for row, (first, last) in enumerate(spans.tolist()):
        grid[row, first:last] = numbers[at : at + last - first]
        at += last - first
    return grid


@contextlib.contextmanager
def _nan_file() -> Any:
    """Give the descriptor of a nameless file of NaN."""
    with tempfile.TemporaryFile() as file:
        file.write(np.full(_NAN_BYTES // 8, np.nan).tobytes())
        file.flush()
        yield file.fileno()


def _map_nan(address: int, size: int, descriptor: int) -> None:
    """Replace whole pages of a mapping by the file of NaN, again and again."""
    libc = ctypes.CDLL(None, use_errno=True)
    libc.mmap.restype = ctypes.c_void_p
    libc.mmap.argtypes = [
        ctypes.c_void_p,
        ctypes.c_size_t,
        ctypes.c_int,
        ctypes.c_int,
        ctypes.c_int,
        ctypes.c_long,
    ]
    for done in range(0, size, _NAN_BYTES):
        length = min(_NAN_BYTES, size - done)
        flags = mmap.MAP_PRIVATE | _MAP_FIXED
        got = libc.mmap(
            address + done, length, mmap.PROT_READ | mmap.PROT_WRITE, flags, descriptor, 0
        )
        if got != address + done:
            raise OSError(ctypes.get_errno(), "cannot map the empty part of a map")


_MAP_FIXED = 0x10
