"""Download of one file of known size by HTTP: resumed where it broke off, tried again, and visible
only when it is complete."""

import contextlib
import hashlib
import http.client
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from isogal.errors import InputError

_CHUNK = 1 << 16
_AGAIN = {408, 425, 429, 500, 502, 503, 504}
Progress = Callable[[int, int], None]


class AbsentError(Exception):
    """The server says that there is no such file (404 or 410)."""


@dataclass(frozen=True)
class Patience:
    """How long to try."""

    timeout: float = 30.0
    """s without a byte after which a try is given up."""
    tries: int = 5
    """Tries in a row that bring nothing new."""
    pause: float = 1.0
    """s before the second try; twice as long before each further one."""


def check_base_url(url: str) -> str:
    """Return the URL without a trailing slash, or raise InputError unless it is an HTTP
    address."""
    parts = urllib.parse.urlsplit(url)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise InputError(
            f"--base-url {url}: must begin with http:// or https:// and name a server"
        )
    return url.rstrip("/")


def download(
    url: str, target: Path, size: int, patience: Patience, progress: Progress | None = None
) -> str:
    """Fetch a file of known size and return its SHA-256.

    What arrived is kept in ``<target>.part``, from which a later call goes on.

    Parameters
    ----------
    url : str
        Address.
    target : Path
        Appears only when it is complete.
    size : int
        Bytes that the file must have.
    patience : Patience
        How long to try.
    progress : callable, optional
        Called with (bytes there, bytes needed).

    Raises
    ------
    AbsentError
        There is no such file.
    InputError
        The server cannot be reached, refuses, or has a file of another size; or the disk is full.
    """
    part = target.with_name(f"{target.name}.part")
    fruitless, there = 0, _size(part)
    while there != size:
        reason = _append(url, part, size, patience.timeout, progress)
        before, there = there, _size(part)
        if there == size:
            break
        fruitless = 0 if there > before else fruitless + 1
        if fruitless >= patience.tries:
            raise InputError(f"{url}: {reason}; gave up after {patience.tries} tries")
        time.sleep(patience.pause * 2.0 ** max(fruitless - 1, 0))
    digest = sha256(part)
    part.replace(target)
    return digest


def _size(part: Path) -> int:
    return part.stat().st_size if part.exists() else 0


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _append(url: str, part: Path, size: int, timeout: float, progress: Progress | None) -> str:
    """Fetch what is missing; returns why another try may help where something still is."""
    there = _size(part) if _size(part) <= size else 0
    headers = {"User-Agent": "isogal", "Accept-Encoding": "identity"}
    if there:
        headers["Range"] = f"bytes={there}-"
    request = urllib.request.Request(url, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=timeout) as answer:
            if answer.status != 206:  # a server that does not resume
                there = 0
            elif not answer.headers.get("Content-Range", "").startswith(f"bytes {there}-"):
                return "the server resumes elsewhere than asked"
            length = answer.headers.get("Content-Length", "")
            if length.isdecimal() and there + int(length) != size:
                part.unlink(missing_ok=True)
                said = f"the server's file has {there + int(length)} bytes, a tile has {size}"
                raise InputError(f"{url}: {said}; wrong address?")
            with part.open("ab") as file:
                file.truncate(there)
                while chunk := answer.read(_CHUNK):
                    there += len(chunk)
                    if there > size:
                        part.unlink()
                        said = f"the server sends more than the {size} bytes of a tile"
                        raise InputError(f"{url}: {said}; wrong address?")
                    file.write(chunk)
                    if progress is not None:
                        progress(there, size)
    except urllib.error.HTTPError as error:
        return _refusal(url, error)
    except (
        urllib.error.URLError,
        http.client.HTTPException,
        ConnectionError,
        TimeoutError,
    ) as error:
        reason = getattr(error, "reason", None) or error
        if isinstance(reason, TimeoutError):
            return f"no answer within {timeout:g} s"
        why = " ".join(str(reason).split()) or type(reason).__name__
        return f"cannot be reached ({why}); offline?"
    except OSError as error:
        raise InputError(f"{part}: cannot be written: {error.strerror or error}") from None
    return f"the connection broke off at {there} of {size} bytes"


def _refusal(url: str, error: urllib.error.HTTPError) -> str:
    """Return why another try may help, by a status of HTTP; raises the error that it means where
    none does."""
    with contextlib.suppress(OSError):
        error.close()
    if error.code in (404, 410):
        raise AbsentError
    reason = f"the server answers {error.code} {error.reason}"
    if error.code not in _AGAIN:
        raise InputError(f"{url}: {reason}")
    return reason
