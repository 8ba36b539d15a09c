"""Checkpoints: values on disk from which an interrupted program goes on.

A file is a line that names the format and its version, the SHA-256 of what follows, and that: a
JSON header and the bytes of arrays. Values are None, numbers, texts, arrays, and lists, tuples,
sets, dictionaries, dataclasses and named tuples of them. No pickle: reading constructs nothing but
these, of the packages that the reader names. Each file has an owner, a text that says what it
belongs to, and is refused by any other."""

import hashlib
import importlib
import json
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from isogal.errors import InputError
from isogal.files import Json, reading, write_atomic

_FORMAT, VERSION = "isogal-checkpoint", 3
LARGEST = 256 * 1024 * 1024
"""Bytes; a larger file is not read."""
_ARRAY_KINDS = "fiub"

Omit = Callable[[Any], bool]
"""Says which values are left out of a checkpoint, to be found anew."""
Restore = Callable[[Mapping[str, Any]], Any]
"""Finds a value that was left out, from the other fields of its dataclass."""


def owner(*documents: Any) -> str:
    """Return the text that stands for documents that JSON can say, such as a scenario and the
    index of a run."""
    text = json.dumps(documents, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True)
class Saved:
    """What a checkpoint holds."""

    time: int
    """When its content was true, ns of the data's stamps."""
    content: Any


def encode(owner: str, saved: Saved, omit: Omit = lambda value: False) -> bytes:
    """Return a checkpoint as bytes; raises TypeError where a value cannot be saved."""
    arrays: list[np.ndarray] = []
    header = {
        "owner": owner,
        "time": saved.time,
        "content": _encode(saved.content, arrays, omit),
    }
    header["arrays"] = [[array.dtype.str, list(array.shape)] for array in arrays]
    text = json.dumps(header, allow_nan=False).encode()
    body = len(text).to_bytes(8, "little") + text + b"".join(map(np.ndarray.tobytes, arrays))
    first = f"{_FORMAT} {VERSION} {hashlib.sha256(body).hexdigest()}\n".encode()
    return first + body


def save(
    path: Path,
    owner: str,
    saved: Saved,
    omit: Omit = lambda value: False,
    sync: bool = True,
) -> None:
    """Write a checkpoint, whole or not at all.

    Parameters
    ----------
    path : Path
    owner : str
        See `owner`.
    saved : Saved
    omit : callable
        Says what is left out.
    sync : bool
        Without it the file survives the end of this process but not that of the machine.

    Raises
    ------
    InputError
        The file cannot be written.
    TypeError
        A value cannot be saved.
    """
    write_atomic(path, encode(owner, saved, omit), sync=sync)


def load(
    path: Path,
    owner: str,
    packages: Collection[str] = ("isogal",),
    restore: Restore | None = None,
) -> Saved | None:
    """Read a checkpoint; None where there is no file.

    Parameters
    ----------
    packages : collection of str
        Dataclasses of these are constructed, of others not.
    restore : callable, optional
        Finds the values that were left out.

    Raises
    ------
    InputError
        The file is damaged, of another version or of another owner, or too large.
    """
    with reading(path):
        if not path.exists():
            return None
        if path.stat().st_size > LARGEST:
            raise InputError(f"{path}: larger than {LARGEST} bytes")
        data = path.read_bytes()
    return decode(data, owner, str(path), packages, restore)


def decode(
    data: bytes,
    owner: str,
    where: str,
    packages: Collection[str] = ("isogal",),
    restore: Restore | None = None,
) -> Saved:
    """Return the content of a checkpoint's bytes.

    Parameters
    ----------
    data : bytes
    owner, packages, restore
        See `load`.
    where : str
        What messages call the bytes, such as their file.
    """
    first, _, body = data.partition(b"\n")
    words = first[:200].decode("ascii", errors="replace").split(" ")
    if len(words) != 3 or words[0] != _FORMAT:
        raise InputError(f"{where}: not a checkpoint")
    if words[1] != str(VERSION):
        raise InputError(f"{where}: version {words[1]} of the format; this is version {VERSION}")
    if hashlib.sha256(body).hexdigest() != words[2]:
        raise InputError(f"{where}: damaged (checksum)")
    try:
        size = int.from_bytes(body[:8], "little")
        header = json.loads(body[8 : 8 + size])
        if header["owner"] != owner:
            raise InputError(f"{where}: of another run or another scenario")
        arrays = _arrays(header["arrays"], memoryview(body)[8 + size :])
        content = _Decoder(arrays, packages, restore).decode(header["content"])
        return Saved(int(header["time"]), content)
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{where}: cannot be used by this version of Isogal") from error


def _arrays(kinds: list[tuple[str, list[int]]], data: memoryview) -> list[np.ndarray]:
    arrays, offset = [], 0
    for name, shape in kinds:
        dtype = np.dtype(name)
        if dtype.kind not in _ARRAY_KINDS or min(shape, default=0) < 0:
            raise ValueError(f"array of {name}")
        count = math.prod(shape)
        array = np.frombuffer(data, dtype, count, offset) if count else np.empty(0, dtype)
        arrays.append(array.reshape(shape).copy())
        offset += count * dtype.itemsize
    return arrays


def _encode(value: Any, arrays: list[np.ndarray], omit: Omit) -> Json:
    """Return what JSON can say of a value; arrays are put aside."""
    encode = partial(_encode, arrays=arrays, omit=omit)
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else {"float": repr(value)}
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in _ARRAY_KINDS:
            raise TypeError(f"an array of {value.dtype} cannot be saved")
        arrays.append(np.ascontiguousarray(value))
        return {"array": len(arrays) - 1}
    if isinstance(value, list):
        return [encode(item) for item in value]
    if isinstance(value, dict):
        return {"dict": [[encode(key), encode(item)] for key, item in value.items()]}
    if isinstance(value, set | frozenset):
        return {"set": [encode(item) for item in sorted(value)]}
    if omit(value):
        return {"omitted": True}
    return _encode_fields(value, encode)


def _encode_fields(value: Any, encode: Callable[[Any], Json]) -> Json:
    kind = type(value)
    if is_dataclass(kind):
        names = [item.name for item in fields(kind) if item.init]
    elif not issubclass(kind, tuple):
        raise TypeError(f"a {kind.__qualname__} cannot be saved")
    elif hasattr(kind, "_fields"):
        names = list(kind._fields)
    else:
        return {"tuple": [encode(item) for item in value]}
    return {
        "class": f"{kind.__module__}:{kind.__qualname__}",
        "fields": {name: encode(getattr(value, name)) for name in names},
    }


@dataclass(frozen=True, slots=True)
class _Decoder:
    arrays: list[np.ndarray]
    packages: Collection[str]
    restore: Restore | None

    def decode(self, value: Any) -> Any:
        """Return the value that JSON stands for."""
        if isinstance(value, list):
            return [self.decode(item) for item in value]
        if not isinstance(value, dict):
            return value
        if "class" in value:
            return self._object(value["class"], value["fields"])
        match value:
            case {"float": text}:
                return float(text)
            case {"array": index}:
                return self.arrays[index]
            case {"dict": pairs}:
                return {self.decode(key): self.decode(item) for key, item in pairs}
            case {"set": items}:
                return frozenset(map(self.decode, items))
            case {"tuple": items}:
                return tuple(map(self.decode, items))
        raise KeyError(*value)

    def _object(self, name: str, encoded: Mapping[str, Json]) -> Any:
        module, _, attribute = name.partition(":")
        if module.split(".")[0] not in self.packages or "." in attribute:
            raise ValueError(f"class {name}")
        kind = getattr(importlib.import_module(module), attribute)
        if not (isinstance(kind, type) and (is_dataclass(kind) or hasattr(kind, "_fields"))):
            raise ValueError(f"class {name}")
        omitted = [key for key, item in encoded.items() if item == {"omitted": True}]
        known = {key: self.decode(item) for key, item in encoded.items() if key not in omitted}
        if omitted and self.restore is None:
            raise ValueError(f"{name}: {omitted[0]} was left out")
        return kind(**known, **{key: self.restore(known) for key in omitted if self.restore})
