"""A folder that does not hold the data ends a study with one line."""

import argparse
import sys
from pathlib import Path

import closed_loop
import pytest

from isogal.maps.load import load_map


def test_a_folder_that_is_not_there(monkeypatch, capsys):
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)  # which the parser replaces
    with pytest.raises(SystemExit):
        closed_loop.parser("", "data").parse_args(["--data", "nowhere"])
    assert "--data: nowhere: no such folder" in capsys.readouterr().err
    assert closed_loop.folder(".") == Path()
    with pytest.raises(argparse.ArgumentTypeError):
        closed_loop.folder(__file__)


@pytest.mark.parametrize("read", [load_map, open])
def test_a_file_that_is_not_there(monkeypatch, capsys, read):
    monkeypatch.setattr(sys, "argv", ["/somewhere/study.py"])
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)  # which the parser replaces
    closed_loop.parser("")
    with pytest.raises(Exception, match=r"no such file|No such file") as caught:
        read("nowhere/map.nc")
    sys.excepthook(caught.type, caught.value, caught.tb)
    said = capsys.readouterr().err
    assert said.startswith("study.py: ")
    assert said.count("\n") == 1
