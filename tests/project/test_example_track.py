"""The example of a recorded track: its README says what comes out."""

import json
import re
import shlex
from pathlib import Path

from helpers.command_line import answer

PLACE = Path(__file__).resolve().parents[2] / "examples" / "recorded_track"


def test_the_documented_fix(tmp_path, monkeypatch) -> None:
    text = (PLACE / "README.md").read_text(encoding="utf-8")
    command = re.search(r"^isogal (match .*)$", text, re.MULTILINE)
    said = re.search(r"^ +1180 +(\S+) +(\S+)", text, re.MULTILINE)
    assert command is not None
    assert said is not None
    words = shlex.split(command[1])
    words[words.index("--out") + 1] = str(tmp_path / "fixes.json")
    monkeypatch.chdir(PLACE)
    answer(*words)
    (fix,) = json.loads((tmp_path / "fixes.json").read_text(encoding="utf-8"))
    assert abs(fix["latitude"] - float(said[1])) < 5e-5
    assert abs(fix["longitude"] - float(said[2])) < 5e-5
