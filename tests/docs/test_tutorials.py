"""What tutorials show works: their commands, one after the other, with smaller numbers."""

from pathlib import Path

import pytest

from helpers.packages import ROOT
from helpers.pages import commands, run_here

DOCS = ROOT / "docs"
LEAVES = {
    "tutorials/survey-to-fix": "out/survey/match/track.png",
    "tutorials/magnetic-aircraft": "out/aircraft/match/track.png",
    "library": "my_match.py",
}
"""Pages, and a file that their last commands make."""
LONGER = (
    "tutorials/plan-fly-compare",
    "tutorials/sensor-driver",
    "tutorials/write-a-matcher",
    "tutorials/your-vehicle",
)
"""Whose commands start workers or nodes as processes; run by `make test-docs`, as all others."""


@pytest.mark.parametrize("name", LEAVES)
def test_a_page(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    run_here(commands(DOCS / f"{name}.md", short=True))
    assert (tmp_path / LEAVES[name]).stat().st_size > 1000


def test_every_tutorial_is_run() -> None:
    tutorials = {f"tutorials/{page.stem}" for page in (DOCS / "tutorials").glob("*.md")}
    assert tutorials <= {*LEAVES, *LONGER}


def test_commands_of_a_page(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "a\n<!-- short: 8=2; big=small -->\n```\nisogal run --runs 8 \\\n  --out big\n```\n"
        "<!-- not run -->\n```\nrm x\n```\n```yaml\na: 1\n```\n```sh\ncat a\n```\n"
    )
    assert commands(page) == ["isogal run --runs 8 --out big", "cat a"]
    assert commands(page, short=True)[0] == "isogal run --runs 2 --out small"
