"""What the pages show, run or not: options of commands exist, scenarios are valid, code parses; of
the library page, that its examples find what it says."""

import ast
import json
import re
import shlex
import tomllib
from collections.abc import Iterator
from itertools import pairwise, takewhile
from pathlib import Path

import pytest
from typer.main import get_command

from helpers.packages import ROOT
from helpers.pages import COMMANDS, blocks, commands, named_files, run_here
from isogal.cli.main import app
from isogal.scenario import load_scenario

PLACES = ("*.md", "docs/**/*.md", "examples/*/*.md", "src/*/*.md", "bags/*.md", "docker/*.md")
PAGES = sorted(path.relative_to(ROOT) for pattern in PLACES for path in ROOT.glob(pattern))
PLUGINS = ("write-a-matcher",)
"""Pages that install a name which is not known here."""
ISOGAL = get_command(app)
DATA_SHEETS = ("# my_sensors.yaml",)
"""YAML blocks that are no scenarios, by the comment they begin with."""


def shown(page: Path) -> Iterator[list[str]]:
    """Yield the words of each command, in blocks and in the text."""
    inline = re.findall(r"`((?:isogal|python) [^`]+)`", (ROOT / page).read_text(encoding="utf-8"))
    in_blocks = [
        line
        for block in blocks(ROOT / page)
        if block.language in COMMANDS
        for line in block.lines()
    ]
    for line in (*in_blocks, *inline):
        words = shlex.split(line, comments=True)
        yield [word for word in words if word != "..."]


def check_command(words: list[str], names_of_plugins: bool) -> None:
    """Assert that the words after ``isogal`` are a command, its options and keys of a scenario."""
    command, rest = ISOGAL, words
    while hasattr(command, "commands") and rest:
        command, rest = command.commands[rest[0]], rest[1:]
    known = {name for parameter in command.params for name in parameter.opts} | {"--help"}
    assert {word.split("=")[0] for word in rest if word.startswith("--")} <= known
    changes = [
        value for option, value in pairwise(rest) if option == "--set" and "FILE" not in value
    ]
    if changes and not names_of_plugins:
        load_scenario(None, changes)


def with_its_modules(script: Path) -> str:
    """Return the text of a script and of what it imports from its own folder."""
    text = script.read_text(encoding="utf-8")
    names = re.findall(r"^(?:import|from) (\w+)", text, flags=re.MULTILINE)
    beside = [path for name in names if (path := script.with_name(f"{name}.py")).exists()]
    return "".join([text, *(path.read_text(encoding="utf-8") for path in beside)])


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_commands_exist(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, text in named_files(ROOT / page).items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    for words in shown(page):
        if words[:1] == ["isogal"] and words[1:2] and not words[1].startswith("-"):
            check_command(words[1:], "plugin" in page.parts or page.stem in PLUGINS)
        elif words[:1] == ["python"] and words[1].endswith(".py"):
            name = words[1].removeprefix("$ROOT/")
            places = (ROOT / name, ROOT / page.parent / name, tmp_path / name)
            text = with_its_modules(next(place for place in places if place.exists()))
            own = takewhile(lambda word: word != "--ros-args", words)
            assert all(f'"{word}"' in text for word in own if word.startswith("--")), words


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_blocks_are_what_they_say(page: Path, tmp_path: Path) -> None:
    for block in blocks(ROOT / page):
        match block.language:
            case "yaml" if not block.text.startswith(DATA_SHEETS):
                (tmp_path / "scenario.yaml").write_text(block.text)
                load_scenario(tmp_path / "scenario.yaml")
            case "json":
                json.loads("{" + block.text + "}" if block.text.startswith('"') else block.text)
            case "python":
                ast.parse(block.text)
            case "toml":
                tomllib.loads(block.text)
            case language:
                assert language in ("", "sh", "text", "yaml", "xml"), f"{page}: {language}"


def test_the_reference_lists_every_package_of_the_library() -> None:
    library = ROOT / "src" / "isogal" / "isogal"
    listed = re.findall(r"^\| `isogal\.(\w+)`", (ROOT / "docs/api/index.md").read_text(), re.M)
    there = {init.parent.name for init in library.glob("*/__init__.py")}
    modules = {name for name in listed if (library / f"{name}.py").is_file()}
    assert {*listed} - modules == there - {"cli", "paper"}  # as in .ci/mkdocs_pages.py


def test_the_library_page_says_what_its_examples_find(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Other pages are run by `make test-docs`."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    run_here(commands(ROOT / "docs" / "library.md", short=True))
    study, match = capsys.readouterr().out.split("NEES")
    assert "bound" in study
    _, place, _ = match.splitlines()[-1].replace(",", ":").split(":")
    latitude, longitude = (float(word) for word in place.split())
    assert abs(latitude + 36.45) < 0.001
    assert abs(longitude - 147.35) < 0.001
