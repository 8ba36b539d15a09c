"""What tutorials show works: their commands, one after the other, with smaller numbers."""

from pathlib import Path

import pytest

from helpers.packages import ROOT
from helpers.pages import commands, run_here

DOCS = ROOT / "docs"
TUTORIALS = DOCS / "tutorials"
FIGURES = {"plan-fly-compare": "out/plan/compared/rms_over_time.png"}
LONGER = (
    *("harbour-to-harbour", "magnetic-aircraft", "sensor-driver", "survey-to-fix"),
    *("write-a-matcher", "your-vehicle"),
)
"""Whose commands take long, are those of other tests, or start workers or nodes as processes; run
by `make test-docs`, as all others."""


@pytest.fixture
def _with_examples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("name", FIGURES)
@pytest.mark.usefixtures("_with_examples")
def test_a_tutorial(name: str, tmp_path: Path) -> None:
    run_here(commands(TUTORIALS / f"{name}.md", short=True))
    assert (tmp_path / FIGURES[name]).stat().st_size > 10_000


@pytest.mark.usefixtures("_with_examples")
def test_the_library_page_says_what_its_examples_find(capsys: pytest.CaptureFixture[str]) -> None:
    run_here(commands(DOCS / "library.md", short=True))
    study, match = capsys.readouterr().out.split("NEES")
    assert "bound" in study
    _, place, _ = match.splitlines()[-1].replace(",", ":").split(":")
    latitude, longitude = (float(word) for word in place.split())
    assert abs(latitude + 36.45) < 0.001
    assert abs(longitude - 147.35) < 0.001


def test_every_tutorial_is_run() -> None:
    assert {page.stem for page in TUTORIALS.glob("*.md")} == {*FIGURES, *LONGER}
