"""Tables and results on the terminal."""

import json
from collections.abc import Collection, Mapping, Sequence

import typer


def print_table(
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    *below: str,
    title: str | None = None,
    words: Collection[int] = (0,),
) -> None:
    """Print rows of text, and lines below them.

    Parameters
    ----------
    header : sequence of str
        Names of the columns.
    rows : sequence of sequences of str
        A cell for each column.
    below : str
        Lines, which are not broken.
    title : str, optional
        Above the header.
    words : collection of int
        Columns that hold words, which begin on the left; the others hold numbers.
    """
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE_HEAD, title=title, title_justify="left", pad_edge=False)
    for index, name in enumerate(header):
        table.add_column(
            Text(name), justify="left" if index in words else "right", overflow="fold"
        )
    for row in rows:
        table.add_row(*map(Text, row))
    console = Console()
    with console.capture() as drawn:
        console.print(table)
    typer.echo("\n".join([drawn.get().removesuffix("\n"), *below]))


def print_json(found: Mapping[str, object]) -> None:
    """Print a result as JSON."""
    typer.echo(json.dumps(found, indent=2, ensure_ascii=False, allow_nan=False))


def print_result(found: Mapping[str, object], as_json: bool, *lines: str) -> None:
    """Print a result: as JSON, or in some lines."""
    if as_json:
        print_json(found)
    else:
        typer.echo("\n".join(lines))
