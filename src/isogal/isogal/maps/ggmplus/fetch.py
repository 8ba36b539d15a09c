"""GGMplus tiles from a mirror into a folder that `isogal.maps.ggmplus.reading` reads.

A download is resumed where it broke off and tried again. The mirrors publish no checksums. So a
tile is trusted when it is fetched for the first time: its SHA-256 goes into ``checksums.txt``
beside it, and from then on a tile that differs from it is refused or fetched again."""

import hashlib
import http.client
import re
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from isogal.errors import InputError
from isogal.files import make_folder, write_atomic
from isogal.maps.axes import Window
from isogal.maps.cache import locked
from isogal.maps.corridor import Corridor
from isogal.maps.ggmplus.tiles import CELLS, KINDS, tile_name, tiles_of

REGISTRY = "checksums.txt"
_CHUNK = 1 << 16
_ABSENT = (404, 410)
"""Statuses of HTTP that say that there is no such file."""
_PAUSE = 1.0
"""s before the second try; twice as long before each further one."""
_AGAIN = (408, 425, 429, 500, 502, 503, 504)
"""Statuses after which another try may help."""
Progress = Callable[[str, int, int], None]
"""Called with (tile, bytes there, bytes needed)."""


class _AbsentError(Exception):
    """The server says that there is no such file."""


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
    timeout: float = 30.0,
    tries: int = 5,
    progress: Progress = lambda name, done, total: None,
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
    timeout : float
        s without a byte after which a try is given up.
    tries : int
        Tries in a row that bring nothing new.
    progress : callable, optional
        See `Progress`.

    Raises
    ------
    InputError
        The server cannot be reached or has other files than tiles, a tile differs from its
        checksum, the folder cannot be written, or the server has none of the tiles.
    """
    if not re.match(r"https?://[^/]", base_url):
        raise InputError(f"--base-url {base_url}: must begin with http:// or https://")
    base_url, folder, result = base_url.rstrip("/"), Path(folder), Fetched(str(folder))
    make_folder(folder)
    try:
        with locked(folder / "fetch", wait=False) as mine:
            if not mine:
                raise InputError(f"{folder}: another isogal map fetch is at work here")
            known = read_registry(folder / REGISTRY)
            for name in names:
                url = f"{base_url}/{name.rpartition('.')[2]}/{name}"
                shown = partial(progress, name)
                fetched = partial(_download, url, timeout=timeout, tries=tries, progress=shown)
                _fetch(name, url, folder, known, result, fetched)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None
    if names and not (result.downloaded or result.present):
        raise InputError(
            f"{base_url}: the server has none of the {len(names)} tiles ({names[0]}, ...); wrong"
            " address?"
        )
    return result


def _fetch(
    name: str,
    url: str,
    folder: Path,
    known: dict[str, str],
    result: Fetched,
    download: Callable[[Path, int], None],
) -> None:
    """Fetch one tile, by what downloads so many bytes into a file, and add what became of it to
    `result` and to the `known` checksums."""
    size = CELLS * CELLS * np.dtype(KINDS[name.rpartition(".")[2]].dtype).itemsize
    path, part, expected = folder / name, folder / f".{name}.part", known.get(name)
    if _size(path) == size and expected in (None, _sha256(path)):  # or not by this program
        result.present.append(name)
    else:
        try:
            download(part, size)
        except _AbsentError:
            result.absent.append(name)
            if expected is None:
                return
            raise InputError(
                f"{url}: the server has it no more; it had when {REGISTRY} was written"
            ) from None
        if expected not in (None, _sha256(part)):
            part.unlink()
            raise InputError(
                f"{url}: differs from the checksum of its first download in {folder / REGISTRY};"
                " damaged on the way, or a new edition: remove its line there to trust it"
            )
        part.replace(path)
        result.downloaded.append(name)
    if expected is None:
        result.trusted.append(name)
        known[name] = _sha256(path)
        head = "# SHA-256 of each tile when it was first fetched (trusted then)\n"
        lines = (f"{tile}  {digest}\n" for tile, digest in sorted(known.items()))
        write_atomic(folder / REGISTRY, head + "".join(lines))


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _download(
    url: str,
    part: Path,
    size: int,
    *,
    timeout: float,
    tries: int,
    progress: Callable[[int, int], None],
) -> None:
    """Fetch what is missing of a file that must have so many bytes; what has arrived stays, and a
    later call goes on from there.

    Raises
    ------
    _AbsentError
        There is no such file.
    InputError
        The server cannot be reached, refuses, or has a file of another size.
    """
    fruitless, there = 0, _size(part)
    while there != size:
        reason = _append(url, part, size, timeout, progress)
        before, there = there, _size(part)
        fruitless = 0 if there > before else fruitless + 1
        if there != size:
            if fruitless >= tries:
                raise InputError(f"{url}: {reason}; gave up after {tries} tries")
            time.sleep(_PAUSE * 2.0 ** max(fruitless - 1, 0))


def _append(
    url: str, part: Path, size: int, timeout: float, progress: Callable[[int, int], None]
) -> str:
    """Try once to fetch what is missing; returns why something may still be."""
    there = _size(part) if _size(part) <= size else 0
    headers = {"User-Agent": "isogal", "Accept-Encoding": "identity"}
    if there:
        headers["Range"] = f"bytes={there}-"
    with part.open("ab") as file:
        try:
            request = urllib.request.Request(url, headers=headers)
            with urllib.request.urlopen(request, timeout=timeout) as answer:
                if answer.status != 206:  # a server that does not resume
                    there = 0
                elif not answer.headers.get("Content-Range", "").startswith(f"bytes {there}-"):
                    return "the server resumes elsewhere than asked"
                file.truncate(there)
                whole = there + int(answer.headers.get("Content-Length", size - there))
                while whole == size and (chunk := answer.read(_CHUNK)):
                    there += len(chunk)
                    whole = max(whole, there)
                    file.write(chunk)
                    progress(min(there, size), size)
        except urllib.error.HTTPError as error:
            if error.code in _ABSENT:
                part.unlink()
                raise _AbsentError from None
            if error.code in _AGAIN:
                return f"the server answers {error.code} {error.reason}"
            raise InputError(f"{url}: the server answers {error.code} {error.reason}") from None
        except (
            urllib.error.URLError,
            http.client.HTTPException,
            ConnectionError,
            TimeoutError,
        ) as error:
            reason = getattr(error, "reason", None) or error
            if isinstance(reason, TimeoutError):
                return f"no answer within {timeout:g} s"
            return f"cannot be reached ({reason or type(reason).__name__}); offline?"
    if whole != size:
        part.unlink()
        raise InputError(
            f"{url}: the server's file has {whole} bytes, a tile has {size}; wrong address?"
        )
    return f"the connection broke off at {there} of {size} bytes"


def read_registry(path: Path) -> dict[str, str]:
    """Return name and SHA-256 of the tiles once fetched, by the file that says it; raises
    InputError where it has a line that does not."""
    text = path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
    known = {}
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() and not line.startswith("#"):
            if not (match := re.fullmatch(r"(\S+)  ([0-9a-f]{64})", line.strip())):
                raise InputError(
                    f"{path} (line {number}): must be a file name, two blanks and a SHA-256"
                )
            known[match[1]] = match[2]
    return known
