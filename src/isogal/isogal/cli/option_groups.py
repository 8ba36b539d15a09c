"""Groups of options: a command has one parameter for a group, the command line one option for each
of its fields.

A group is a frozen dataclass whose fields are annotated as typer wants the parameters of a
command, so each option is declared once, however many commands have it. Where it has a `PANEL`,
that is the heading of its options in the help."""

import functools
import inspect
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import MISSING, fields, is_dataclass
from typing import Annotated, Any, get_args, get_type_hints


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
    def wrapper(**values: Any) -> None:
        for name, group in groups.items():
            given = [field.name for field in fields(group) if field.name in values]
            values[name] = group(**{option: values.pop(option) for option in given})
        command(**values)

    wrapper.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return wrapper


def _parameters(group: type) -> Iterator[inspect.Parameter]:
    """Yield the fields of a group as parameters."""
    hints = get_type_hints(group, include_extras=True)
    for field in fields(group):
        yield inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            annotation=_in_panel(hints[field.name], getattr(group, "PANEL", None)),
            default=inspect.Parameter.empty if field.default is MISSING else field.default,
        )


def _in_panel(annotation: Any, panel: str | None) -> Any:
    """Return the annotation of an option with its heading in the help."""
    kind, option = get_args(annotation)
    option = copy(option)
    option.rich_help_panel = option.rich_help_panel or panel
    return Annotated[kind, option]
