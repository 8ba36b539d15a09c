"""Compiled functions on disk: reused when nothing has changed, never when something has."""

import importlib
import os
import pkgutil
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from numba.core.dispatcher import Dispatcher

import isogal
from helpers.fresh import Fresh
from isogal.compiled import digest

LIBRARY = Path(isogal.__file__).parent

CALLEE = """
from isogal.compiled import kernel
from constants import FACTOR

@kernel
def scaled(x):
    return FACTOR * x + 1.0
"""
CALLER = """
from isogal.compiled import kernel
{how}

@kernel
def twice(x):
    return 2.0 * {name}(x)
"""
BY_NAME = CALLER.format(how="from callee import scaled", name="scaled")
BY_MODULE = CALLER.format(how="import callee", name="callee.scaled")
ASK = """
from caller import twice
from other_caller import twice as other
kept, made = (sum(sum(getattr(f.stats, n).values()) for f in (twice, other))
              for n in ("cache_hits", "cache_misses") if [twice(3.0), other(3.0)])
print(twice(3.0), other(3.0), kept, made)
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "constants.py").write_text("FACTOR = 10.0\n")
    (tmp_path / "callee.py").write_text(CALLEE)
    (tmp_path / "caller.py").write_text(BY_NAME)
    (tmp_path / "other_caller.py").write_text(BY_MODULE)
    return tmp_path


@pytest.fixture(scope="module", autouse=True)
def fresh() -> Iterator[None]:
    _fresh.append(Fresh())
    yield
    _fresh.pop().close()


_fresh: list[Fresh] = []


def run(folder: Path, code: str, **environment: str) -> str:
    """Return what code says in a process that has loaded no kernel yet."""
    return _fresh[0].run(folder, code, _environment(environment))


def _environment(more: dict[str, str]) -> dict[str, str]:
    return {k: v for k, v in os.environ.items() if not k.startswith("NUMBA")} | more


def ask(folder: Path, **environment: str) -> tuple[float, str]:
    """Return what both callers compute in a fresh process, and where their machine code came
    from."""
    value, other, hits, misses = run(folder, ASK, **environment).split()
    assert value == other
    return float(value), {"20": "disk", "02": "compiler"}[hits + misses]


def files(folder: Path, function: str) -> list[str]:
    return sorted(path.name for path in (folder / "__pycache__").glob(f"{function}-*"))


def test_change_in_another_file_reaches_the_callers(folder: Path) -> None:
    assert ask(folder) == (62.0, "compiler")
    assert ask(folder) == (62.0, "disk")
    (folder / "callee.py").write_text(CALLEE.replace("1.0", "2.0"))
    assert ask(folder) == (64.0, "compiler")
    (folder / "constants.py").write_text("FACTOR = 20.0\nOTHER = 1\n")  # two files below
    assert ask(folder) == (124.0, "compiler")
    assert ask(folder) == (124.0, "disk")
    for caller in ("caller.twice", "other_caller.twice"):
        # index and code of this version, none of the earlier ones
        assert len(files(folder, caller)) == 2


def test_install_that_cannot_be_written(folder: Path) -> None:
    (folder / "__pycache__").write_text("")  # a file, so that not even root gets a folder there
    home = folder / "home"
    for origin in ("compiler", "disk"):
        assert ask(folder, HOME=str(home), XDG_CACHE_HOME=str(home / "cache")) == (62.0, origin)
    assert list(home.rglob("caller.twice-*.nbi"))


def test_many_processes_at_once(folder: Path) -> None:
    code = f"""
import contextlib, io, os
for _ in range(3):
    if os.fork() == 0:
        with contextlib.redirect_stdout(io.StringIO()) as said:
            exec({ASK!r})
        os.write(1, said.getvalue().encode())
        os._exit(0)
assert [os.wait()[1] for _ in range(3)] == [0, 0, 0]
"""
    said = [line.split() for line in run(folder, code).splitlines()]
    assert [words[0] for words in said] == ["62.0"] * 3
    assert sum(int(words[3]) for words in said) == 2  # each caller was compiled by one of them
    assert ask(folder) == (62.0, "disk")


def modules() -> Iterator[ModuleType]:
    for package in ("isogal", "isogal_ros"):
        try:
            found = importlib.import_module(package)
        except ImportError:  # no ROS here
            continue
        for info in pkgutil.walk_packages(found.__path__, f"{package}."):
            yield importlib.import_module(info.name)


def test_every_compiled_function_is_a_kernel() -> None:
    found = {
        value
        for module in modules()
        for value in vars(module).values()
        if isinstance(value, Dispatcher)
    }
    assert len(found) > 50
    for compiled in found:
        assert digest(compiled), compiled
    sources: list[Any] = [path for path in LIBRARY.rglob("*.py") if path.name != "compiled.py"]
    assert [path for path in sources if "njit" in path.read_text()] == []


def test_compiling_is_said_once_and_not_where_all_is_on_disk(folder: Path) -> None:
    code = (
        "from isogal.compiled import tell_of_compiling\n"
        "tell_of_compiling(lambda: print('compiles'))\n"
        "from caller import twice\n"
        "print(twice(1.0), twice(1))"
    )
    assert run(folder, code).split() == ["compiles", "22.0", "22.0"]
    assert run(folder, code).split() == ["22.0", "22.0"]
