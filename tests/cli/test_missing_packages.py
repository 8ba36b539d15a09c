"""What a plain installation says where a command needs more."""

import pytest

from isogal.cli.errors import clean_errors


def test_the_extra_is_named(capsys) -> None:
    @clean_errors
    def needs() -> None:
        raise ModuleNotFoundError("No module named 'rasterio.crs'", name="rasterio.crs")

    with pytest.raises(SystemExit) as ended:
        needs()
    assert ended.value.code == 2
    assert "pip install 'isogal[maps]'" in capsys.readouterr().err


def test_a_module_of_our_own_that_is_missing_is_a_defect() -> None:
    @clean_errors
    def broken() -> None:
        raise ModuleNotFoundError("No module named 'isogal.nothing'", name="isogal.nothing")

    with pytest.raises(ModuleNotFoundError):
        broken()
