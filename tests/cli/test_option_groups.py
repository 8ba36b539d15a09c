"""Groups of options: one parameter of a command, one option for each field."""

from dataclasses import dataclass
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from isogal.cli.option_groups import with_groups


@dataclass(frozen=True)
class Journey:
    start: Annotated[str, typer.Argument()]
    speed: Annotated[float, typer.Option("--speed", help="In m/s.")] = 22.0


@dataclass(frozen=True)
class SeaJourney(Journey):
    start: Annotated[str, typer.Option("--from")]


def app_of(command):
    app = typer.Typer()
    app.command()(with_groups(command))
    return app


def travel(journey: Journey, to: Annotated[str, typer.Argument()], count: int = 1) -> None:
    """Go there."""
    print(f"{journey.start} to {to} at {journey.speed:g}, {count} times")


def sail(journey: SeaJourney) -> None:
    print(journey.start, journey.speed)


@pytest.mark.parametrize(
    ("words", "printed"),
    [
        (["A", "B"], "A to B at 22, 1 times\n"),
        (["A", "B", "--speed", "5", "--count", "2"], "A to B at 5, 2 times\n"),
    ],
)
def test_fields_are_options(words, printed):
    result = CliRunner().invoke(app_of(travel), words)
    assert (result.exit_code, result.stdout) == (0, printed)


def test_help_shows_the_fields_and_the_docstring():
    shown = CliRunner().invoke(app_of(travel), ["--help"]).stdout
    assert "Go there." in shown
    assert "In m/s." in shown
    assert "journey" not in shown


def test_a_group_may_declare_a_field_anew():
    result = CliRunner().invoke(app_of(sail), ["--from", "Hobart"])
    assert (result.exit_code, result.stdout) == (0, "Hobart 22.0\n")


def test_called_from_python_fields_have_their_defaults(capsys):
    with_groups(sail)(start="Hobart")
    assert capsys.readouterr().out == "Hobart 22.0\n"


def test_two_options_of_one_name_are_refused():
    def twice(first: Journey, second: SeaJourney) -> None: ...

    with pytest.raises(ValueError, match="duplicate parameter name: 'start'"):
        with_groups(twice)
