"""GGMplus tiles that were written are read back."""

from dataclasses import replace

import numpy as np
import pytest

from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.field_map import FieldMap
from isogal.maps.ggmplus.tiles import CELLS, KINDS
from isogal.maps.ggmplus.writing import write_ggmplus
from isogal.maps.load import load_map


def test_a_value_that_does_not_fit_and_a_quantity_that_is_not_there(tmp_path, small_map):
    large = replace(small_map, values=small_map.values + 0.1)
    with pytest.raises(InputError, match="a value does not fit into"):
        write_ggmplus(large, tmp_path / "tiles")
    magnetic = replace(small_map, unit="nT", quantity="magnetic_anomaly")
    with pytest.raises(InputError, match="GGMplus has no magnetic_anomaly files; it has"):
        write_ggmplus(magnetic, tmp_path / "tiles")
    assert not list(tmp_path.rglob("*.*"))


@pytest.mark.parametrize("extension", sorted(KINDS))
def test_written_tiles_come_back(tmp_path, extension):
    kind = KINDS[extension]
    lat = np.radians(-35.05 + 0.001 + 0.002 * np.arange(40))
    lon = np.radians(144.97 + 0.001 + 0.002 * np.arange(30))
    middle = 9.8 if extension == "ga" else 0.0
    values = middle + kind.step * np.random.default_rng(1).integers(-300, 300, (40, 30))
    values[6, 4] = np.nan
    unit = {"ha": "m", "xi": "rad", "eta": "rad"}.get(extension, "m/s²")
    paths = write_ggmplus(FieldMap(lat, lon, values, unit, kind.quantity), tmp_path / "tiles")
    assert {p.stat().st_size for p in paths} == {CELLS * CELLS * np.dtype(kind.dtype).itemsize}
    part = Window(lat[4], lat[-5], lon[4], lon[-5])
    read = load_map(tmp_path / "tiles", extension, window=part)
    found = read.value(lat[4:-4, None], lon[4:-4])  # which passes through the nodes
    known = np.isfinite(found)
    assert known.mean() > 0.95
    np.testing.assert_allclose(found[known], values[4:-4, 4:-4][known], atol=1e-3 * kind.step)
