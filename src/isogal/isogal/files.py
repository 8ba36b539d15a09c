"""Files that are either whole or absent."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from isogal.errors import InputError


@contextmanager
def atomic_path(path: str | Path, make_folder: bool = False, sync: bool = True) -> Iterator[Path]:
    """Give a temporary path beside ``path``, which takes its name only when the block ends well.

    Whoever reads ``path`` sees the old file or the new one, also when this process is killed.

    Parameters
    ----------
    path : path
    make_folder : bool
        Whether missing folders are made; otherwise they are an error.
    sync : bool
        Whether the file is brought to the disk before it takes its name.

    Raises
    ------
    InputError
        The file or its folder cannot be written.
    """
    path = Path(path)
    try:
        if make_folder:
            path.parent.mkdir(parents=True, exist_ok=True)
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
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        temporary.unlink(missing_ok=True)


def write_atomic(
    path: str | Path, data: bytes | str, make_folder: bool = False, sync: bool = True
) -> None:
    """Write a whole file, text as UTF-8; see `atomic_path`."""
    with atomic_path(path, make_folder, sync) as temporary:
        temporary.write_bytes(data.encode("utf-8") if isinstance(data, str) else data)
