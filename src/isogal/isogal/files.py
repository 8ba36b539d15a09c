"""Files that are either whole or absent, and the folders that they are in."""

import csv
import io
import math
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from isogal.errors import InputError

Json = None | bool | int | float | str | Sequence["Json"] | Mapping[str, "Json"]
"""What JSON can say."""


def make_folder(folder: str | Path) -> None:
    """Make a folder for what is to be written, unless it is there; raises InputError."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise InputError(f"{folder}: is a file, where a folder is needed") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from None


def check_output(path: str | Path, folder: bool = False, where: str = "") -> None:
    """Raise InputError, which begins with ``where``, if a file (or a folder, with files in it)
    could not be written: to be asked before what takes long. It is tried, as some file systems
    refuse what their permissions allow."""
    path = Path(path)
    if path.exists() and path.is_dir() != folder:
        what = "file, where a folder" if folder else "folder, where a file"
        raise InputError(f"{where}{path}: is a {what} is needed")
    there = path if folder else path.parent
    while not there.exists():
        there = there.parent
    try:
        with tempfile.TemporaryDirectory(prefix=".isogal-", dir=there):
            pass
    except OSError as error:
        raise InputError(f"{where}{path}: cannot be written: {there}: {error.strerror}") from None


@contextmanager
def atomic_path(path: str | Path, sync: bool = True) -> Iterator[Path]:
    """Give a temporary path beside ``path``, which takes its name only when the block ends well.

    Whoever reads ``path`` sees the old file or the new one, also when this process is killed.

    Parameters
    ----------
    path : path
        Folders that are missing are made.
    sync : bool
        Whether the file is brought to the disk before it takes its name.

    Raises
    ------
    InputError
        The file or its folder cannot be written.
    """
    path = Path(path)
    make_folder(path.parent)
    try:
        handle, name = tempfile.mkstemp(
            prefix=f".{path.name}.", suffix=f".part{path.suffix}", dir=path.parent
        )
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        if sync:
            with temporary.open("rb") as stream:
                os.fsync(stream.fileno())
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
    except OSError as error:
        why = error.strerror or str(error)
        if (error.errno or 0) < 0:  # of a C library, which does not say what the system has said
            why += "; is the disk full?"
        raise InputError(f"{path}: cannot be written: {why}") from None
    except RuntimeError as error:  # what C libraries raise, for example where the disk is full
        raise InputError(f"{path}: cannot be written: {error}") from None
    finally:
        temporary.unlink(missing_ok=True)


def write_atomic(path: str | Path, data: bytes | str, sync: bool = True) -> None:
    """Write a whole file, text as UTF-8; see `atomic_path`."""
    with atomic_path(path, sync) as temporary:
        temporary.write_bytes(data.encode("utf-8") if isinstance(data, str) else data)


def unreadable(path: str | Path, kind: str) -> InputError:
    """Return the error of a file that cannot be read as a format, without the words of the library
    that found it so: they are about its own functions."""
    empty = Path(path).is_file() and Path(path).stat().st_size == 0
    why = "is empty" if empty else "is damaged, cut short, or of another format"
    return InputError(f"{path}: cannot be read as {kind}: the file {why}")


@contextmanager
def reading(path: str | Path, kind: str | None = None) -> Iterator[None]:
    """Turn what goes wrong while a file is read into one line that names it.

    Parameters
    ----------
    path : path
    kind : str, optional
        Format that a library reads, such as ``NetCDF``: whatever that raises means that the file
        is damaged. None = text, or a file of Isogal's own.

    Raises
    ------
    InputError
        As it is, or of a file that cannot be read.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        # the C libraries' own numbers are negative, or missing
        of_system = isinstance(error, OSError) and (error.errno or 0) > 0
        if kind is not None and not of_system:  # libraries have no base class of their own errors
            raise unreadable(path, kind) from error
        if isinstance(error, OSError):
            raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
        if isinstance(error, UnicodeDecodeError):
            raise InputError(f"{path}: is not a text file (UTF-8)") from None
        raise


def changed_at(path: str | Path) -> int:
    """Return when a file was changed, ns (0 = there is none): an argument of functions whose
    results are kept, so that they read it anew."""
    return Path(path).stat().st_mtime_ns if Path(path).exists() else 0


def csv_text(rows: Sequence[Mapping[str, object]]) -> str:
    """Return rows as comma-separated values with a header; a cell that a row has not is empty."""
    stream = io.StringIO()
    names = dict.fromkeys(key for row in rows for key in row)
    writer = csv.DictWriter(stream, fieldnames=list(names), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()


def geojson_line(points: Sequence[Sequence[float]]) -> dict[str, Json]:
    """Return a line as a geometry of GeoJSON (RFC 7946), in pieces at longitude 180.

    Parameters
    ----------
    points : K lists
        Longitude, latitude (deg; the former in any range), and what else a position has. A piece
        of one point has it twice, as a line needs two.
    """
    pieces: list[list[Sequence[float]]] = []
    before = math.inf
    for longitude, *rest in points:
        within = longitude if -180.0 <= longitude <= 180.0 else (longitude + 180.0) % 360.0 - 180.0
        if abs(within - before) > 180.0:
            pieces.append([])
        pieces[-1].append([within, *rest])
        before = within
    lines = [piece * 2 if len(piece) == 1 else piece for piece in pieces]
    if len(lines) == 1:
        return {"type": "LineString", "coordinates": lines[0]}
    return {"type": "MultiLineString", "coordinates": lines}
