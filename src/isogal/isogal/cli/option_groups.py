"""Groups of options: a command has one parameter for a group, the command line one option for each
of its fields.

A group is a frozen dataclass whose fields are annotated as typer wants the parameters of a
command, so each option is declared once, however many commands have it. Where it has a `PANEL`,
that is the heading of its options in the help."""

import functools
import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Annotated, TypeVar, get_args, get_type_hints

import typer
from typer.main import get_command

from isogal.cli.checks import OUTPUT, not_read_too

Value = TypeVar("Value")
"""Of an option: whatever typer makes of its annotation."""


def with_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command as typer understands it: where a parameter is a group, with its fields as
    parameters.

    Raises
    ------
    ValueError
        Two parameters have the same name.
    """
    groups: dict[str, type] = {}
    parameters: list[inspect.Parameter] = []
    for parameter in inspect.signature(command, eval_str=True).parameters.values():
        annotation = parameter.annotation
        if isinstance(annotation, type) and is_dataclass(annotation):
            groups[parameter.name] = annotation
            parameters += _parameters(annotation)
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))

    @functools.wraps(command)
    def wrapper(**values: Value) -> None:
        written = {name: values[name] for name in _written(parameters)}
        read = [
            word for name, value in values.items() if name not in written for word in _words(value)
        ]
        not_read_too([Path(word) for value in written.values() for word in _words(value)], read)
        of_groups = {
            name: group(**{field.name: values.pop(field.name) for field in fields(group)})
            for name, group in groups.items()
        }
        command(**values, **of_groups)

    vars(wrapper)["__signature__"] = inspect.Signature(parameters)
    return wrapper


def run_with_groups(command: Callable[..., None], words: Sequence[str]) -> None:
    """Call a command with options as they stand on a command line.

    Raises
    ------
    typer.TyperException
        A word is no option, or its value is not allowed.
    """
    app = typer.Typer(add_completion=False)
    app.command()(with_groups(command))
    get_command(app).main(list(words), standalone_mode=False)


def _written(parameters: Iterable[inspect.Parameter]) -> Iterator[str]:
    """Yield the names of the parameters that name files to be written."""
    for parameter in parameters:
        declared = get_args(parameter.annotation)[1:]
        if any(hasattr(getattr(one, "callback", None), OUTPUT) for one in declared):
            yield parameter.name


def _words(value: object) -> Iterator[str]:
    """Yield what of an option's value may be the name of a file: also in ``KEY=FILE,...``."""
    for one in value if isinstance(value, list) else [value]:
        if isinstance(one, Path | str):
            yield str(one)
            yield from re.split("[=,]", str(one))


def _parameters(group: type) -> Iterator[inspect.Parameter]:
    """Yield the fields of a group as parameters."""
    hints = get_type_hints(group, include_extras=True)
    for field in fields(group):
        kind, declared = get_args(hints[field.name])
        option = copy(declared)
        option.rich_help_panel = option.rich_help_panel or getattr(group, "PANEL", None)
        yield inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            annotation=Annotated[kind, option],
            default=inspect.Parameter.empty if field.default is MISSING else field.default,
        )
