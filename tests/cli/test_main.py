"""The program `isogal`: what it lists, how it starts, how its commands fail."""

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import pytest
import typer
from typer.main import get_command
from typer.testing import CliRunner

from helpers.command_line import answer, call
from isogal import __version__
from isogal.cli import main
from isogal.errors import InputError

HEAVY = ("numpy", "numba", "scipy", "xarray", "pandas", "matplotlib", "rclpy", "dask")


def plain(runs: Annotated[int, typer.Option(min=1)] = 3, out: Path = Path("out")) -> None:
    """Do something.

    A sentence that the
    source breaks goes on.
    """
    print(f"{runs} runs into {out}")


def bad_input() -> None:
    raise InputError("scenario.yaml: route.speed:\n must be positive")


def interrupted() -> None:
    raise KeyboardInterrupt


def unreadable() -> None:
    Path("/nonexistent/file").read_text()


def defect() -> None:
    raise ZeroDivisionError("a defect, not an input")


@pytest.fixture
def sample(monkeypatch):
    """Add commands that only fail, each in its own way."""
    group = typer.Typer()
    group.command("first")(plain)
    group.command("second")(bad_input)
    for kind in ("registered_commands", "registered_groups"):
        monkeypatch.setattr(main.app, kind, [*getattr(main.app, kind)])
    for command in (plain, bad_input, interrupted, unreadable, defect):
        main.app.command(command.__name__)(command)
    main.app.add_typer(group, name="group")


def test_version_help_and_refusals_start_without_the_numerical_packages():
    code = f"""
import sys
from isogal.cli.main import app

for words in (
    "--version", "--help", "nix", "match --help", "map info --help", "montecarlo --runs none"
):
    sys.argv = ["isogal", *words.split()]
    try:
        app()
    except SystemExit:
        pass
    loaded = [name for name in {HEAVY!r} if name in sys.modules]
    assert not loaded, (words, loaded)
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "program",
    [
        [Path(sys.executable).with_name("isogal")],
        [sys.executable, "-m", "isogal"],
        [sys.executable, "-m", "isogal.cli.main"],
    ],
)
def test_the_program_as_a_process_tells_its_version(program):
    words = [*program, "--version"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"isogal {__version__}\n", "")


def test_help_lists_all_commands_and_each_has_its_own():
    listed = " ".join(answer("--help").split())
    commands = get_command(main.app).commands
    assert len(commands) == 13
    for name, command in commands.items():
        assert f"{name} {command.help.split()[0]}" in listed
        assert f"Usage: isogal {name}" in " ".join(answer(name, "--help").split())
    status, out, err = call()
    assert status == 2 and "Usage: isogal" in out + err


def test_a_function_becomes_a_command_whose_help_fills_the_line(sample):
    assert answer("plain", "--runs", "2", "--out", "here") == "2 runs into here\n"
    result = CliRunner().invoke(main.app, ["plain", "--help"], env={"COLUMNS": "100"})
    assert "A sentence that the source breaks goes on." in result.output


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["bad_input"], 2, "isogal: scenario.yaml: route.speed: must be positive\n"),
        (["group", "second"], 2, "isogal: scenario.yaml: route.speed: must be positive\n"),
        (["unreadable"], 2, "isogal: /nonexistent/file: No such file or directory\n"),
        (["interrupted"], 130, "isogal: interrupted\n"),
        (["plain", "--runs", "0"], 2, "isogal: Invalid value for '--runs'"),
        (["plain", "--rnus", "1"], 2, "isogal: No such option: --rnus"),
        (["plain", "stray"], 2, "isogal: Got unexpected extra argument"),
        (["bad_inputs"], 2, "isogal: No such command 'bad_inputs'. Did you mean 'bad_input'"),
        (["--no-such-flag"], 2, "isogal: No such option: --no-such-flag (see isogal --help)\n"),
    ],
)
def test_failures_end_in_one_line(sample, arguments, status, message):
    ended, out, err = call(*arguments)
    assert (ended, out) == (status, "")
    assert err.startswith(message)
    assert err.count("\n") == 1


def test_a_defect_keeps_its_traceback(sample):
    with pytest.raises(ZeroDivisionError):
        call("defect")
