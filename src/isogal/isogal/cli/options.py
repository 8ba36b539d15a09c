"""Options that several commands share: scenario, workers, folder and form of the results."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer
from typer.models import OptionInfo

from isogal.cli.checks import finite, output_file, output_folder

if TYPE_CHECKING:
    from isogal.scenario import Scenario

RESULTS = "Results"
"""Heading of the options that say what becomes of the results."""

MOST_RUNS = 1_000_000
"""Of a study, whose records have numbers of six digits."""
Json = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON.", rich_help_panel=RESULTS)
]


def number(
    help_: str,
    unit: str | None = None,
    check: Callable[..., float | None] = finite,
    least: float | None = None,
    most: float | None = None,
) -> OptionInfo:
    """Return an option that is a number.

    Parameters
    ----------
    help_ : str
        What it means.
    unit : str, optional
        Shown in place of the number, such as ``KM``.
    check : callable
        One of `isogal.cli.checks`.
    least, most : float, optional
        Smallest and largest number that are allowed.
    """
    return typer.Option(metavar=unit, callback=check, help=help_, min=least, max=most)


def text(metavar: str, help_: str, *names: str) -> OptionInfo:
    """Return an option that is a word or a file, in place of which `metavar` is shown; default of
    its names: the parameter's."""
    return typer.Option(*names, metavar=metavar, help=help_)


def flag(name: str, help_: str) -> OptionInfo:
    """Return an option that is there or not."""
    return typer.Option(name, help=help_)


Workers = Annotated[
    int | None, number("Processes on this machine; default: one for each core.", "N", least=1)
]
Scheduler = Annotated[str | None, text("ADDRESS", "Dask scheduler to use, e.g. tcp://host:8786.")]


def written_folder(help_: str) -> OptionInfo:
    """Return the option of a folder that is written into, which is checked before all else."""
    return typer.Option(metavar="DIR", callback=output_folder, help=help_, rich_help_panel=RESULTS)


def written_file(metavar: str, help_: str, *suffixes: str) -> OptionInfo:
    """Return the option of a file that is written, which is checked before all else: whether it
    can be, and whether its name ends in one of the suffixes, if there are any."""
    return typer.Option(
        metavar=metavar,
        callback=output_file(*suffixes),
        help=help_,
        rich_help_panel=RESULTS,
    )


@dataclass(frozen=True)
class ScenarioChoice:
    """Which scenario."""

    scenario: Annotated[
        Path | None, text("FILE", "Scenario file (YAML); default: all defaults.")
    ] = None
    set_: Annotated[
        list[str] | None,
        text("KEY=VALUE", "Change a key, e.g. gravimeter.sigma=2e-4; repeatable.", "--set"),
    ] = None

    def load(self, *changes: str) -> "Scenario":
        """Return the scenario with the changes of ``--set``, then these; raises InputError. A
        sigma that seems to be in another unit is said."""
        from isogal.fields.measured import unlikely_sigmas
        from isogal.scenario import load_scenario

        scenario = load_scenario(self.scenario, [*(self.set_ or ()), *changes])
        for line in unlikely_sigmas(scenario):
            typer.echo(f"isogal: {line}", err=True)
        return scenario


@dataclass(frozen=True)
class StudyResults:
    """What becomes of the results of many runs."""

    PANEL: ClassVar = RESULTS

    out: Annotated[Path, written_folder("Folder of results, report, figures and finished runs.")]
    json: Json = False

    @property
    def runs(self) -> Path:
        """Folder of the finished runs."""
        return self.out / "runs"
