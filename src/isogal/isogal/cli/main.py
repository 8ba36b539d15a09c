"""The program ``isogal``. Its commands import what they compute with when they are called:
``isogal --help`` starts without NumPy and numba."""

import io
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, NoReturn

import typer
from typer.core import TyperGroup

from isogal import __version__
from isogal.cli import bag, mag, montecarlo, paper, plan, run, view
from isogal.cli.errors import clean_errors, fail
from isogal.cli.map.app import app as map_app
from isogal.cli.match.command import match
from isogal.threads import one_thread


class _Isogal(TyperGroup):
    """The group of all commands, which ends every failure that a user can cause with one line."""

    def main(self, args: Sequence[str] | None = None, *_: object, **__: object) -> NoReturn:
        """Run and exit; replaces the boxes in which typer would frame an error."""
        sys.exit(_call(self, list(sys.argv[1:] if args is None else args)))


@clean_errors
def _call(group: _Isogal, args: list[str]) -> int:
    try:
        with group.make_context("isogal", args) as context:
            group.invoke(context)
        status = 0
    except typer.Exit as exit_:
        status = exit_.exit_code
    except typer.Abort:
        fail("aborted", 1)
    except typer.TyperException as error:
        message = error.format_message()
        if message:  # there is none where the help was shown because no command was named
            where = getattr(error, "ctx", None)
            hint = f" (see {where.command_path} --help)" if where else ""
            fail(f"{message.strip().rstrip('.')}{hint}", error.exit_code)
        status = error.exit_code
    sys.stdout.flush()  # a full disk or a closed pipe is reported here, not at exit
    return status


app = typer.Typer(
    cls=_Isogal,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
for _command in (
    *(run.run, run.replay, run.smooth, run.faults, montecarlo.montecarlo, paper.paper),
    *(match, bag.bag, view.view, view.compare, plan.plan),
):
    app.command()(_command)
app.add_typer(mag.app, name="mag")
app.add_typer(map_app, name="map")


def _show_version(value: bool) -> None:
    if value:
        typer.echo(f"isogal {__version__}")
        raise typer.Exit


@app.callback()
def isogal(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Navigation by map matching when there is no GNSS.

    A gravimeter and a gravity map stop an inertial navigator from drifting. Every command has its
    own --help."""


def main() -> None:
    """Run the program (`isogal.cli.start`)."""
    one_thread()
    _open_streams()
    app()


def _open_streams() -> None:
    """Let what is printed come out, whatever the terminal: a stream that the shell has closed is
    as one to nowhere, and a character that the encoding lacks is a question mark."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


if __name__ == "__main__":
    main()
