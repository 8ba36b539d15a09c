"""Definitions of message types as the schemas of an MCAP file (encoding ``ros2msg``)."""

import sys
from functools import lru_cache
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

SEPARATOR = "=" * 80
BUILTIN = frozenset(
    (
        "bool",
        "byte",
        "char",
        "float32",
        "float64",
        "string",
        "wstring",
        *(f"{u}int{n}" for u in ("", "u") for n in (8, 16, 32, 64)),
    )
)


@lru_cache(maxsize=64)
def schema_text(type_name: str) -> str:
    """Return the definition of a message type (``package/msg/Name``) and of all it contains."""
    parts = [_definition(type_name)]
    seen, queue = {type_name}, _contained(type_name)
    while queue:
        inner = queue.pop(0)
        if inner not in seen:
            seen.add(inner)
            package, _, name = inner.split("/")
            parts.append(f"{SEPARATOR}\nMSG: {package}/{name}\n{_definition(inner)}")
            queue += _contained(inner)
    return "\n".join(parts)


@lru_cache(maxsize=64)
def _definition(type_name: str) -> str:
    package, _, name = type_name.split("/")
    return (_share(package) / "msg" / f"{name}.msg").read_text(encoding="utf-8")


def _share(package: str) -> Path:
    """Return a package's share folder; packages from wheels are not in the ament index unless the
    environment names the venv."""
    try:
        return Path(get_package_share_directory(package))
    except (PackageNotFoundError, OSError):
        return Path(sys.prefix) / "share" / package


def _contained(type_name: str) -> list[str]:
    """List the message types that a definition's fields have."""
    package = type_name.split("/", maxsplit=1)[0]
    found = []
    for line in _definition(type_name).splitlines():
        words = line.partition("#")[0].split()
        if len(words) < 2 or "=" in words[1]:
            continue
        base = words[0].partition("[")[0].partition("<")[0]
        if base in BUILTIN:
            continue
        owner, _, name = base.rpartition("/")
        found.append(f"{owner.split('/')[0] or package}/msg/{name}")
    return found
