"""Whatever a file holds, a reader gives a map or one clear line; it never crashes and never
hangs. Files with something changed are in `test_hostile_files`."""

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


def map_or_one_line(path, *asked, **options):
    try:
        field_map = load_map(path, *asked, **options)
    except InputError as error:
        assert "\n" not in str(error) and str(error)
    else:
        assert isinstance(field_map, FieldMap) and field_map.values.size


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
