"""Definitions of message types as the schemas of an MCAP file (encoding ``ros2msg``)."""

import re
import sys
from functools import cache
from importlib import import_module
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

SEPARATOR = "=" * 80


@cache
def schema_text(type_name: str) -> str:
    """Return the definition of a message type (``package/msg/Name``) and of all it contains."""
    names, parts = [type_name], list[str]()
    for one in names:  # which grows
        package, _, name = one.split("/")
        text = (_share(package) / "msg" / f"{name}.msg").read_text(encoding="utf-8")
        parts.append(f"{SEPARATOR}\nMSG: {package}/{name}\n{text}" if parts else text)
        kind = getattr(import_module(f"{package}.msg"), name)
        of_fields = " ".join(kind.get_fields_and_field_types().values())
        inner = [f"{owner}/msg/{part}" for owner, part in re.findall(r"(\w+)/(\w+)", of_fields)]
        names += [found for found in dict.fromkeys(inner) if found not in names]
    return "\n".join(parts)


def _share(package: str) -> Path:
    """Return a package's share folder; packages from wheels are not in the ament index unless the
    environment names the venv."""
    try:
        return Path(get_package_share_directory(package))
    except (PackageNotFoundError, OSError):
        return Path(sys.prefix) / "share" / package
