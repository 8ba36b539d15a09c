"""The file of coefficients: there and back, and what is refused."""

import numpy as np
import pytest
import yaml

from helpers.magnetics import STROBE, aircraft, fly
from isogal.errors import InputError
from isogal.magnetics.compensation import Compensation, read_compensation
from isogal.magnetics.manoeuvres import ordinary_flight


def compensation():
    coefficients = np.concatenate([aircraft().coefficients(), STROBE])
    return Compensation(coefficients, ("strobe",), 3.5, 0.1, 0.01 * np.abs(coefficients))


def test_there_and_back(tmp_path):
    compensation().write(tmp_path / "a.yaml")
    found = read_compensation(tmp_path / "a.yaml")
    for name in ("coefficients", "currents", "offset", "lag", "sigma"):
        np.testing.assert_array_equal(getattr(found, name), getattr(compensation(), name))


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("isogal_magnetic_compensation", 2, "version 2"),
        ("scale_nt", 1.0, "scale_nt"),
        ("permanent", {"x": 1.0, "y": 2.0}, "permanent: must have x, y, z"),
        ("induced", "much", "induced"),
        ("offset", float("nan"), "offset"),
        ("lag", True, "lag"),
        ("currents", {"strobe": [1.0]}, "currents.strobe"),
        ("sigma", [1.0], "sigma"),
        ("color", 1, "unknown key 'color'"),
    ],
)
def test_files_that_are_refused(tmp_path, key, value, said):
    document = compensation().document() | {key: value}
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
    with pytest.raises(InputError, match=said):
        read_compensation(tmp_path / "a.yaml")


@pytest.mark.parametrize("text", ["", "- 1", "a: [", "!!python/object:os.system x", "a: 1"])
def test_files_of_another_kind(tmp_path, text):
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(InputError, match=r"a\.yaml"):
        read_compensation(tmp_path / "a.yaml")
    with pytest.raises(InputError, match="cannot be read"):
        read_compensation(tmp_path / "none.yaml")


def test_a_current_that_was_not_recorded_is_named():
    readings, _ = fly(ordinary_flight(1, minutes=1.0), aircraft())
    with pytest.raises(InputError, match="current_strobe"):
        compensation().clean(readings)
