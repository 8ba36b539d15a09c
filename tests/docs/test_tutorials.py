"""What the tutorials show works: their commands, one after the other, with smaller numbers."""

from pathlib import Path

import pytest

from helpers.packages import ROOT
from helpers.pages import commands, run_here

TUTORIALS = ROOT / "docs" / "tutorials"
FIGURES = {
    "survey-to-fix": "out/survey/match/track.png",
    "magnetic-aircraft": "out/aircraft/match/track.png",
    "plan-fly-compare": "out/plan/compared/rms_over_time.png",
}


@pytest.mark.parametrize("name", FIGURES)
def test_a_tutorial(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    run_here(commands(TUTORIALS / f"{name}.md", short=True))
    assert (tmp_path / FIGURES[name]).stat().st_size > 10_000


def test_every_tutorial_is_run() -> None:
    assert {page.stem for page in TUTORIALS.glob("*.md")} == set(FIGURES)


def test_commands_of_a_page(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "a\n<!-- short: 8=2; big=small -->\n```\nisogal run --runs 8 \\\n  --out big\n```\n"
        "<!-- not run -->\n```\nrm x\n```\n```yaml\na: 1\n```\n```sh\ncat a\n```\n"
    )
    assert commands(page) == ["isogal run --runs 8 --out big", "cat a"]
    assert commands(page, short=True)[0] == "isogal run --runs 2 --out small"
