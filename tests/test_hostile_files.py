"""Files from strangers are read or refused in one line."""

import re
from pathlib import Path

import pytest

from helpers.hostile import READERS, mutated, valid_files
from isogal.errors import InputError
from isogal.seeds import generator

EACH = 40
FOREIGN = re.compile(
    r"Errno|Error\b|\b[A-Z]\w+Exceeded|could not convert|reshape|out of (range|bounds)"
)
"""Words of libraries."""


@pytest.fixture(scope="module")
def valid(tmp_path_factory, small_map) -> dict[str, bytes]:
    return valid_files(tmp_path_factory.mktemp("valid"), small_map)


@pytest.mark.filterwarnings("ignore")  # of rasterio and SciPy, of what they read
@pytest.mark.parametrize("name", READERS)
def test_a_changed_or_random_file_is_read_or_refused(name, valid, tmp_path) -> None:
    if name not in valid:
        pytest.skip("needs ROS 2 (rclpy)")
    path = Path(tmp_path / name)
    path.write_bytes(valid[name])
    READERS[name](path)
    for k in range(EACH):
        rng = generator(5, k, f"hostile file: {name}")
        path.write_bytes(mutated(valid[name], rng) if k % 8 else rng.bytes(50 * k))
        try:
            READERS[name](path)
        except InputError as error:
            assert len(str(error)) < 2000
            assert str(error).count(str(path)) == 1 and "\n" not in str(error)
            assert not FOREIGN.search(str(error)), error
    assert [entry.name for entry in tmp_path.iterdir()] == [name]
