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


@pytest.fixture
def clock(monkeypatch):
    now = [1000.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_without_a_terminal_a_line_now_and_then(jobs, clock, capsys):
    with LiveProgress("study") as shown:
        shown.begin(jobs, 6)
        clock[0] += LINE_EVERY
        shown.finished(jobs[0])
        shown.say("a line")
    # 600 of 1200 s in 15 s
    assert capsys.readouterr().err.splitlines() == [
        "6 of 8 runs are there already",
        "study: 7/8 runs, 40 x real time, 15 s left",
        "a line",
    ]


def test_on_a_terminal_a_bar(jobs, monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    with LiveProgress("study") as shown:
        for _ in range(2):  # what is shown second takes the place of the first
            shown.begin(jobs, 0)
            shown.finished(jobs[0])
            assert [(task.completed, task.total) for task in shown._bar.tasks] == [(600, 1200)]
            assert shown._bar.tasks[0].fields["runs"] == "1/2 runs"
        shown.say("a line [not markup of rich]")
    said = terminal.getvalue()
    assert "study" in said
    assert "1/2 runs" in said
    assert "a line" in said
    assert said.rindex("\x1b[?25h") > said.rindex("\x1b[?25l")  # the cursor is back
