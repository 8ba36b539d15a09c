"""What a study shows of its progress."""

import io

import pytest

from helpers.studies import small_scenario
from isogal.montecarlo import progress
from isogal.montecarlo.cases import Case, Job
from isogal.montecarlo.progress import LINE_EVERY, LiveProgress


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def jobs(field_map):
    """Two runs of ten minutes."""
    case = Case("small", small_scenario(), 2, field_map)
    return [Job(case, 0), Job(case, 1)]


def test_without_a_terminal_a_line_now_and_then(jobs, monkeypatch, capsys):
    now = 1000.0
    monkeypatch.setattr(progress.time, "monotonic", lambda: now)
    with LiveProgress("study") as shown:
        shown.begin(jobs, 6)
        now += LINE_EVERY
        shown.computed(jobs[0])
        shown.say("a line")
    # one of two runs in 15 s
    assert capsys.readouterr().err.splitlines() == [
        "6 of 8 runs are there already",
        "study: 7/8 runs, 15 s left",
        "a line",
    ]


def test_on_a_terminal_a_bar(jobs, monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    with LiveProgress("study") as shown:
        shown.begin(jobs, 0)
        shown.computed(jobs[0])
        shown.say("a line [not markup of rich]")
    said = terminal.getvalue()
    for text in ("study", "1/2", "a line [not markup of rich]"):
        assert text in said
    assert said.rindex("\x1b[?25h") > said.rindex("\x1b[?25l")  # the cursor is back
