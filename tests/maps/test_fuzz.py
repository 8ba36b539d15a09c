"""Whatever a file holds, a reader gives a map or one clear line; it never crashes and never
hangs."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from helpers.map_files import WRITERS
from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.field_map import FieldMap
from isogal.maps.ggmplus.tiles import CELLS
from isogal.maps.load import load_map

FUZZ = settings(
    max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)


change = st.tuples(st.floats(0.0, 1.0), st.binary(min_size=1, max_size=8))
damage = st.fixed_dictionaries(
    {
        "changes": st.lists(change, max_size=6),
        "cut": st.one_of(st.none(), st.floats(0.0, 1.0)),
        "early": st.booleans(),
    }
)


def spoil(good: bytes, how) -> bytes:
    """Overwrite some bytes (mostly in the header, where they matter) and cut."""
    body = bytearray(good)
    reach = min(len(body), 2000) if how["early"] else len(body)
    for where, what in how["changes"]:
        at = int(where * reach)
        body[at : at + len(what)] = what
    return bytes(body[: int(how["cut"] * len(body))] if how["cut"] is not None else body)


def map_or_one_line(path, *asked, **options):
    try:
        field_map = load_map(path, *asked, **options)
    except InputError as error:
        assert "\n" not in str(error) and str(error)
    else:
        assert isinstance(field_map, FieldMap) and field_map.values.size


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", WRITERS)
def test_damaged_files(name, small_map, tmp_path):
    path = tmp_path / name
    WRITERS[name](path, small_map)
    good = path.read_bytes()
    assert load_map(path).quantity == "disturbance"

    @FUZZ
    @given(damage)
    def check(how):
        path.write_bytes(spoil(good, how))
        map_or_one_line(path)

    check()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", [*WRITERS, "S40E140.dg"])
def test_files_of_random_bytes(name, tmp_path):
    path = tmp_path / name

    @FUZZ
    @given(st.one_of(st.binary(max_size=400), st.text(max_size=400).map(str.encode)))
    def check(content):
        path.write_bytes(content)
        map_or_one_line(path)

    check()


def test_damaged_tiles(tmp_path):
    path = tmp_path / "S40E140.dg"
    good = np.zeros((CELLS, CELLS), ">i2")
    good[:60, :60] = 321
    good = good.reshape(-1)
    window = Window(*np.radians([-39.95, -39.9, 140.05, 140.1]))

    @settings(FUZZ, max_examples=20)
    @given(
        st.lists(st.tuples(st.integers(0, 100_000), st.integers(-(2**15), 2**15 - 1)), max_size=9),
        st.integers(-3, 3),
    )
    def check(changes, longer):
        spoilt = good.copy()
        for at, number in changes:
            spoilt[at] = number
        body = spoilt.tobytes()
        path.write_bytes(body[:longer] if longer < 0 else body + b"x" * longer)
        map_or_one_line(tmp_path, "dg", window=window)

    check()
