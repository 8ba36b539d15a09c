"""Where files and folders can be written, and what is said where they cannot."""

from pathlib import Path

import pytest

from isogal.errors import InputError
from isogal.files import (
    atomic_path,
    check_output,
    geojson_line,
    make_folder,
    reading,
    write_atomic,
)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder, the current one, with a file and a folder in it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("kept")
    (tmp_path / "folder").mkdir()
    return tmp_path


BAD = [
    ("folder", False, "folder: is a folder, where a file is needed"),
    ("file", True, "file: is a file, where a folder is needed"),
    ("file/new/x.csv", False, "file/new/x.csv: cannot be written: file: Not a directory"),
    ("file/new", True, "file/new: cannot be written: file: Not a directory"),
]


@pytest.mark.parametrize(("path", "folder", "message"), BAD)
def test_what_cannot_be_written_is_known_before(
    here: Path, path: str, folder: bool, message: str
) -> None:
    with pytest.raises(InputError) as error:
        check_output(path, folder)
    assert str(error.value) == message
    with pytest.raises(InputError, match=f"^{path}|^file/new"):  # and is not written
        make_folder(path) if folder else write_atomic(path, "new")
    assert Path("file").read_text() == "kept"


def test_a_file_system_that_refuses_what_its_permissions_allow() -> None:
    with pytest.raises(InputError, match=r"^bag: /proc/x/y: cannot be written: /proc: No such"):
        check_output("/proc/x/y", folder=True, where="bag: ")


def test_a_full_disk_of_which_a_library_says_a_number_of_its_own(here: Path) -> None:
    with (
        pytest.raises(InputError, match=r"^x\.nc: cannot be written: NetCDF: HDF error; is the"),
        atomic_path("x.nc"),
    ):
        raise OSError(-101, "NetCDF: HDF error")
    assert not list(here.glob("*x.nc*"))


def test_what_a_library_cannot_read_is_said_without_its_words(here: Path) -> None:
    Path("empty").touch()
    errors = OSError(-101, "NetCDF: HDF error", "file"), OSError("no TIFF"), ValueError("a\nb")
    for error in errors:
        for name, why in [
            ("file", "is damaged, cut short, or of another format"),
            ("empty", "is empty"),
        ]:
            with pytest.raises(InputError) as caught, reading(name, "NetCDF"):
                raise error
            assert str(caught.value) == f"{name}: cannot be read as NetCDF: the file {why}"
    with (
        pytest.raises(InputError, match="file: cannot be read: Permission denied"),
        reading("file", "NetCDF"),
    ):
        raise PermissionError(13, "Permission denied")


@pytest.mark.parametrize("path", ["new.csv", "file", "folder/x", "a/b/c.csv"])
def test_the_rest_is_written_with_its_folders(here: Path, path: str) -> None:
    check_output(path)
    assert not Path("a").exists()
    write_atomic(path, "new")
    assert Path(path).read_text() == "new"
    check_output(Path(path).parent, folder=True)


def test_lines_of_geojson_are_cut_at_the_date_line_and_have_two_points() -> None:
    assert geojson_line([[180.0, 1.0], [179.0, 2.0]]) == {
        "type": "LineString",
        "coordinates": [[180.0, 1.0], [179.0, 2.0]],
    }
    assert geojson_line([[179.0, 1.0, 5.0], [179.5, 2.0, 5.0], [180.5, 3.0, 5.0]]) == {
        "type": "MultiLineString",
        "coordinates": [[[179.0, 1.0, 5.0], [179.5, 2.0, 5.0]], [[-179.5, 3.0, 5.0]] * 2],
    }
    assert geojson_line([[7.0, 1.0]])["coordinates"] == [[7.0, 1.0], [7.0, 1.0]]
