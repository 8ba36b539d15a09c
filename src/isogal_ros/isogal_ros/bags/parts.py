"""The files of one bag, in the order in which they were written."""

import re
from pathlib import Path

_NUMBER = re.compile(r"_(\d+)\.mcap(\.zstd)?$")
SUFFIXES = (".mcap", ".mcap.zstd")


def parts(folder: Path) -> list[Path]:
    """Return the MCAP files of a folder, by their number (``<bag>_0.mcap``, ``<bag>_1.mcap``)."""
    if not folder.is_dir():
        return []
    files = [file for file in folder.iterdir() if file.name.endswith(SUFFIXES)]
    return sorted(files, key=_order)


def numbered(files: list[Path]) -> bool:
    """Whether files are the parts of one bag: numbered from 0 on, with one name."""
    names = {_NUMBER.sub("", file.name) for file in files}
    return len(names) == 1 and [_order(file)[0] for file in files] == list(range(len(files)))


def _order(file: Path) -> tuple[int, str]:
    found = _NUMBER.search(file.name)
    return (int(found.group(1)) if found else -1, file.name)
