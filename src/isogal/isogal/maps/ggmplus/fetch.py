"""GGMplus tiles from a mirror into a folder that `isogal.maps.ggmplus.reading` reads.

The mirrors publish no checksums. So a tile is trusted when it is fetched for the first time: its
SHA-256 goes into ``checksums.txt`` beside it, and from then on a tile that differs from it is
refused or fetched again."""

import contextlib
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from isogal.errors import InputError
from isogal.files import atomic_path, make_folder
from isogal.maps.axes import Window
from isogal.maps.cache import locked
from isogal.maps.corridor import Corridor
from isogal.maps.ggmplus.download import AbsentError, Patience, check_base_url, download, sha256
from isogal.maps.ggmplus.tiles import CELLS, KINDS, tile_name, tiles_of

REGISTRY = "checksums.txt"
_LINE = re.compile(r"(\S+)  ([0-9a-f]{64}|absent)")


@dataclass
class Fetched:
    """What became of each tile; names in the order asked for."""

    folder: str
    downloaded: list[str] = field(default_factory=list)
    present: list[str] = field(default_factory=list)
    """Were there already and agree with their checksum."""
    absent: list[str] = field(default_factory=list)
    """The server has no such tile: open sea, or beyond 60 degrees."""
    trusted: list[str] = field(default_factory=list)
    """Fetched for the first time: nothing to compare their checksum with."""


def tiles_for(where: Window | Corridor, extensions: Iterable[str]) -> list[str]:
    """Return the names of the tiles that a window, or a route and its margin, needs."""
    windows = where.windows() if isinstance(where, Corridor) else [where]
    corners = sorted({corner for window in windows for corner in tiles_of(window)})
    names: list[str] = []
    for extension in extensions:
        if extension not in KINDS:
            raise InputError(f"--variable {extension}: GGMplus has {', '.join(KINDS)}")
        names += [tile_name(*corner, extension) for corner in corners]
    return names


def fetch_tiles(
    names: list[str],
    base_url: str,
    folder: str | Path,
    *,
    patience: Patience | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Fetched:
    """Fetch tiles that are not there yet.

    Parameters
    ----------
    names : list of str
        As `tiles_for` gives them.
    base_url : str
        Folder on the server that holds the folders ``ga``, ``dg``, ...
    folder : path
        Made if it is not there.
    patience : Patience, optional
        How long to try.
    progress : callable, optional
        Called with (tile, bytes there, bytes needed).

    Raises
    ------
    InputError
        The server cannot be reached or has other files than tiles, a tile differs from its
        checksum, the folder cannot be written, or the server has none of the tiles.
    """
    base_url, folder = check_base_url(base_url), Path(folder)
    make_folder(folder)
    result = Fetched(str(folder))
    with _alone(folder):
        known = read_registry(folder)
        for name in names:
            _one(name, base_url, folder, known, result, patience or Patience(), progress)
    if names and not (result.downloaded or result.present):
        raise InputError(
            f"{base_url}: the server has none of the {len(names)} tiles ({names[0]}, ...); wrong"
            " address?"
        )
    return result


def _one(
    name: str,
    base_url: str,
    folder: Path,
    known: dict[str, str],
    result: Fetched,
    patience: Patience,
    progress: Callable[[str, int, int], None] | None,
) -> None:
    extension = name.rpartition(".")[2]
    size = CELLS * CELLS * np.dtype(KINDS[extension].dtype).itemsize
    url = f"{base_url}/{extension}/{name}"
    path, new, expected = folder / name, folder / f".{name}.new", known.get(name)
    digest = sha256(path) if path.is_file() and path.stat().st_size == size else None
    if digest is not None and expected in (None, digest):  # as fetched, or not by this program
        result.present.append(name)
    else:
        try:
            digest = download(
                url,
                new,
                size,
                patience,
                (lambda done, total: progress(name, done, total)) if progress else None,
            )
        except AbsentError:
            result.absent.append(name)
            if expected is None:
                return
            raise InputError(
                f"{url}: the server has it no more; it had when {REGISTRY} was written"
            ) from None
        if expected not in (None, digest):
            new.unlink()
            raise InputError(
                f"{url}: differs from the checksum of its first download in {folder / REGISTRY};"
                " damaged on the way, or a new edition: remove its line there to trust it"
            )
        new.replace(path)
        result.downloaded.append(name)
    if expected is None:
        result.trusted.append(name)
        known[name] = digest
        write_registry(folder, known)


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Lock the folder against a second fetch."""
    try:
        with locked(folder / "fetch", wait=False) as mine:
            if not mine:
                raise InputError(f"{folder}: another isogal map fetch is at work here")
            yield
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None


def read_registry(folder: Path) -> dict[str, str]:
    """Return name and SHA-256 of the tiles once fetched into a folder.

    Raises
    ------
    InputError
        A line that is none.
    """
    path = folder / REGISTRY
    if not path.exists():
        return {}
    known = {}
    for number, line in enumerate(
        path.read_text(encoding="utf-8", errors="replace").splitlines(), start=1
    ):
        if not line.strip() or line.startswith("#"):
            continue
        match = _LINE.fullmatch(line.strip())
        if not match:
            raise InputError(
                f"{path} (line {number}): must be a file name, two blanks and a SHA-256"
            )
        if match.group(2) != "absent":  # earlier versions wrote which tiles the server had not
            known[match.group(1)] = match.group(2)
    return known


def write_registry(folder: Path, known: dict[str, str]) -> None:
    """Write the registry, whole or not at all."""
    head = "# SHA-256 of each tile when it was first fetched (trusted then)\n"
    lines = "".join(f"{name}  {digest}\n" for name, digest in sorted(known.items()))
    with atomic_path(folder / REGISTRY) as temporary:
        temporary.write_text(head + lines, encoding="utf-8")
