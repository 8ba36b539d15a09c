"""Packages with entry points that are known in this process alone."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from isogal import plugins


def forget() -> None:
    """Look for entry points anew when one is asked for next."""
    for known in (plugins._installed, plugins._registered):
        known.cache_clear()


@contextmanager
def known(folder: Path) -> Iterator[None]:
    """Let what is installed in a folder be found meanwhile."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        forget()
        yield
    forget()


def install(folder: Path, package: str, module: str, **groups: dict[str, str]) -> None:
    """Install a package of one module; targets of its entry points by group and name."""
    metadata = folder / f"{package}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\n")
    lines = []
    for group, targets in groups.items():
        lines += [f"[isogal.{group}]", *(f"{name} = {to}" for name, to in targets.items())]
    (metadata / "entry_points.txt").write_text("\n".join([*lines, ""]))
    (folder / f"{package}.py").write_text(module)
    forget()
