"""Fixtures that every test package shares."""

import gc
import json
import os
import signal
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from isogal.threads import one_thread

# Nothing that is imported while tests are found becomes garbage; searching it for some again and
# again is a quarter of the time that finding them takes. On again in pytest_collection_finish.
gc.disable()

# As Isogal's own programs: two test processes on two cores would fight for them. Before NumPy is
# loaded.
one_thread()

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

from helpers.batches import field_map_of, wavy  # noqa: E402
from helpers.example_field import disturbance  # noqa: E402
from isogal.errors import InputError  # noqa: E402
from isogal.fields import derived_maps  # noqa: E402
from isogal.fields.derived_maps import shared_maps  # noqa: E402
from isogal.maps.field_map import FieldMap  # noqa: E402
from isogal.maps.synthetic import tiles  # noqa: E402
from isogal.scenario import validate_scenario  # noqa: E402

# No deadline: a first call compiles, and the machine may be busy. The same examples at every run,
# so that more of them would find what is wrong once or never.
settings.register_profile("isogal", deadline=None, derandomize=True, max_examples=25)
settings.load_profile("isogal")

# Commands that the tests interrupt must hear it, also where a shell without job control has
# started the tests in the background: then SIGINT is ignored, and a child inherits that.
signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parents[1]

# Tiles of the synthetic map are made once for all tests and workers, and not in the user's cache.
os.environ["ISOGAL_CACHE"] = str(ROOT / "build" / "test-cache")

TESTPATHS = pytest.Config.ArgsSource.TESTPATHS
"""Of a call that names no tests."""
FIRST = (
    *("ros/graph/test_closed_loop.py", "benchmarks/test_measured_data.py", "test_compiled.py"),
    *("ros/isogal_bringup", "docs", "ros/graph", "montecarlo", "ros", "benchmarks", "paper"),
    *("project", "tracks", "evaluation", "cli/match", "maps/gridding"),
    "matching/pmht/test_closed_loop.py",
)
"""Folders and files that take longest; before them one for each worker, which do not wait for each
other: the first compiles the filter and makes the recording of `ros/conftest.py`, the second the
matcher, and the third kernels of its own."""


def pytest_collection(session: pytest.Session) -> None:
    """Have each worker find the tests in files of its own first. What is compiled to bytecode is
    a third of them then, and the rest the others have done: together they once did it three
    times, for 15 s."""
    worker, count = (os.environ.get(f"PYTEST_XDIST_WORKER{end}") for end in ("", "_COUNT"))
    if worker is None or count is None or session.config.args_source is not TESTPATHS:
        return
    folders = Path(__file__).parent, ROOT / "examples"
    files = sorted(str(path) for folder in folders for path in folder.rglob("test_*.py"))
    first = len(files) * int(worker.removeprefix("gw")) // int(count)
    session.config.args[:] = files[first:] + files[:first]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put files that take long first: a worker that gets one last would go on alone."""
    items.sort(key=lambda item: (_turn(item.path), item.path))


@cache
def _turn(path: Path) -> int:
    """Return the place in `FIRST` of a file, or of a folder that it is in."""
    places = (Path(__file__).parent / name for name in FIRST)
    found = (turn for turn, place in enumerate(places) if place in (path, *path.parents))
    return next(found, len(FIRST))


def pytest_collection_finish() -> None:
    """Search for garbage again, seldom: a test makes little of it, and the process ends soon."""
    gc.freeze()
    gc.set_threshold(20_000, 20, 10)
    gc.enable()


@pytest.fixture(scope="module", autouse=True)
def nothing_old_is_searched_for_garbage() -> Iterator[None]:
    """Thousands of tests, numba and matplotlib are there to stay, and a collection of garbage that
    looks at them takes a fifth of a second. What is garbage already would stay as well."""
    gc.collect()
    gc.freeze()
    yield


@pytest.fixture(scope="session", autouse=True)
def maps_here() -> Iterator[None]:
    """Maps that are computed from others are computed once for all tests of a worker, and by it,
    as are tiles of the synthetic map: a process of their own takes seconds to begin."""

    def derived(words: list[Any], *, input: bytes, **_: object) -> SimpleNamespace:
        task = json.loads(input)
        try:
            made = derived_maps.compute(validate_scenario(task["scenario"]), task["margin"])
        except InputError as error:
            refused = derived_maps._REFUSED
            return SimpleNamespace(returncode=refused, stdout=str(error).encode())
        derived_maps._write(words[-1], made)
        return SimpleNamespace(returncode=0)

    def no_other_process(*_: object, **__: object) -> None:
        raise OSError

    with pytest.MonkeyPatch.context() as patch, shared_maps():
        patch.setattr(derived_maps, "subprocess", SimpleNamespace(run=derived))
        patch.setattr(
            tiles, "subprocess", SimpleNamespace(Popen=no_other_process, PIPE=0, DEVNULL=0)
        )
        yield


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the test data beside the repository; skips the test where there is none."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the shared test data (../shared/data) is not present")
    return folder


@pytest.fixture(scope="session")
def small_map() -> FieldMap:
    """A map that every format can hold: 20 x 24 nodes, 0.05 deg apart, near 37 S, 145 E."""
    lat, lon = -37.0 + 0.05 * np.arange(20), 144.5 + 0.05 * np.arange(24)
    return FieldMap(
        np.radians(lat),
        np.radians(lon),
        disturbance(lat[:, None], lon[None, :]),
        "m/s²",
        "disturbance",
        provenance="small",
    )


@pytest.fixture(scope="session")
def rough_map() -> FieldMap:
    """A rough disturbance map, 80 km on a side."""
    return field_map_of(wavy)
