"""The program ``isogal``. It knows the name and one line of each command, and imports a command
only when it is called: ``isogal --help`` starts without NumPy and numba."""

import importlib
import io
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from isogal import __version__
from isogal.cli.errors import clean_errors, fail
from isogal.threads import one_thread

if TYPE_CHECKING:
    from typer._click import Command, Context


class Place(NamedTuple):
    """Where a command lives: ``attribute`` of ``isogal.cli.<module>`` is a function, or a
    ``typer.Typer`` with commands of its own."""

    module: str
    attribute: str
    help: str


COMMANDS = {
    "run": Place(
        "run",
        "run",
        "Simulate a scenario with the navigator in the loop; write a bag, figures and a report.",
    ),
    "replay": Place(
        "run",
        "replay",
        "Feed a recording to fresh matcher and filter nodes; say how far the fixes differ.",
    ),
    "smooth": Place(
        "smooth", "smooth", "Say of each moment of a recorded voyage what all its data know of it."
    ),
    "faults": Place(
        "run", "faults", "Run the nodes with faulty sensors, links and nodes; table of the harm."
    ),
    "montecarlo": Place(
        "montecarlo",
        "montecarlo",
        "Run a scenario many times with other random numbers; write the statistics.",
    ),
    "paper": Place(
        "paper",
        "paper",
        "Reproduce every table and figure of the paper, beside the paper's values.",
    ),
    "match": Place(
        "match.command", "match", "Match a recorded track of any scalar field against a map."
    ),
    "bag": Place("bag", "bag", "Make a recording of a table of what an INS has said."),
    "view": Place(
        "view", "view", "Write one page to look through a run: map, errors, messages over time."
    ),
    "compare": Place("view", "compare", "Put runs or studies side by side."),
    "plan": Place(
        "plan", "plan", "Find the route on which the navigator arrives with the least error."
    ),
    "mag": Place("mag", "app", "Clean a magnetometer of the vehicle's own field."),
    "map": Place("map.app", "app", "Look at maps, make, fetch and convert them."),
}


class _Deferred(TyperCommand):
    """A command in the list of commands, which is imported when it is called."""

    def make_context(
        self,
        info_name: str | None,
        args: list[str],
        parent: "Context | None" = None,
        **extra: object,
    ) -> "Context":
        return _load(str(self.name)).make_context(info_name, args, parent=parent, **extra)


def _load(name: str) -> "Command":
    where = COMMANDS[name]
    target = getattr(importlib.import_module(f"isogal.cli.{where.module}"), where.attribute)
    if not isinstance(target, typer.Typer):
        app = typer.Typer(add_completion=False)
        app.command(name)(target)
        target = app
    command = get_command(target)
    command.name = name
    _fill_paragraphs(command)
    return command


def _fill_paragraphs(command: "Command", below: bool = True) -> None:
    """Let the help of a command, which is its docstring, fill the width of the terminal: keep the
    paragraphs, join their lines."""
    if command.help:
        command.help = "\n\n".join(
            " ".join(paragraph.split()) for paragraph in command.help.split("\n\n")
        )
    for one in getattr(command, "commands", {}).values() if below else ():
        _fill_paragraphs(one)


class _Isogal(TyperGroup):
    """The group of all commands, which ends every failure that a user can cause with one line."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        for name, where in COMMANDS.items():
            self.add_command(
                _Deferred(name, help=where.help, rich_markup_mode=self.rich_markup_mode)
            )

    def main(self, args: Sequence[str] | None = None, *_: object, **__: object) -> NoReturn:
        """Run and exit; replaces the boxes in which typer would frame an error."""
        sys.exit(_call(self, list(sys.argv[1:] if args is None else args)))


@clean_errors
def _call(group: _Isogal, args: list[str]) -> int:
    _fill_paragraphs(group, below=False)
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
    cls=_Isogal, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)


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
