"""What a study shows of its progress."""

import io

import pytest

from helpers.studies import small_scenario
from isogal.maps.field_map import FieldMap
from isogal.montecarlo import progress
from isogal.montecarlo.chunks import Case, Chunk, divide
from isogal.montecarlo.progress import LINE_EVERY, LiveProgress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def chunks(field_map: FieldMap) -> list[Chunk]:
    """Four runs of ten minutes, in two."""
    case = Case("small", small_scenario(), 4, field_map)
    return divide(case, [0, 1, 2, 3], 2)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [1000.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_without_a_terminal_a_line_now_and_then(chunks, clock, capsys) -> None:
    assert [len(chunk.runs) for chunk in chunks] == [2, 2]
    with LiveProgress("study") as shown:
        shown.begin(chunks, 6)
        clock[0] += LINE_EVERY
        shown.finished(chunks[0])
        shown.say("a line")
    # 1200 of 2400 s in 15 s
    assert capsys.readouterr().err.splitlines() == [
        "6 of 10 runs are there already",
        "study: 8/10 runs, 80 x real time, 15 s left",
        "a line",
    ]


def test_on_a_terminal_a_bar(chunks, monkeypatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    with LiveProgress("study") as shown:
        for _ in range(2):  # what is shown second takes the place of the first
            shown.begin(chunks, 0)
            shown.finished(chunks[0])
            assert [(task.completed, task.total) for task in shown._bar.tasks] == [(1200, 2400)]
            assert shown._bar.tasks[0].fields["runs"] == "2/4 runs"
        shown.say("a line [not markup of rich]")
    said = terminal.getvalue()
    assert "study" in said
    assert "2/4 runs" in said
    assert "a line" in said
    assert said.rindex("\x1b[?25h") > said.rindex("\x1b[?25l")  # the cursor is back
