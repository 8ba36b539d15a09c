"""HTML reports: one page with its figures embedded, and the same figures as PNG files beside
it."""

import base64
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import isogal
from isogal.evaluation.figures import style
from isogal.files import write_atomic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NUMBER = re.compile(r"([<>≤≥±]?\s*[-−+]?\d[\d.,]*(e[-+]?\d+)?\s*%?(\s*(/|of)\s*\d+)?|–)?")


@dataclass(frozen=True, slots=True, eq=False)
class Illustration:
    """A figure with its caption; `name` is the stem of its PNG file."""

    name: str
    figure: "Figure"
    caption: str


@dataclass(frozen=True, eq=False)
class Table:
    """A table of text cells (see `number` for figures); columns of numbers only are set flush
    right."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    folded: bool = False
    """Whether the reader has to open it."""

    @cached_property
    def numeric(self) -> frozenset[int]:
        """Indices of the columns that hold numbers only."""
        if not self.rows:
            return frozenset()
        columns = range(len(self.header))
        return frozenset(
            c for c in columns if all(_NUMBER.fullmatch(row[c].strip()) for row in self.rows)
        )


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """A heading with text, figures and tables, in that order."""

    heading: str
    paragraphs: Sequence[str] = ()
    illustrations: Sequence[Illustration] = ()
    tables: Sequence[Table] = ()
    listing: str = ""
    """All settings, to be shown as they are, folded."""


def number(value: float | None, digits: int = 3) -> str:
    """Write a number for a table: so many significant digits at least, no exponent from 1e-3 to
    1e6, a dash for none."""
    if value is None or math.isnan(value):
        return "–"
    if value == 0:
        return "0"
    size = abs(value)
    if not 1e-3 <= size < 1e6:
        return f"{value:.{digits - 1}e}"
    text = f"{value:#.{digits}g}"
    return f"{value:.0f}" if "e" in text or text.endswith(".") else text


def write_report(
    out_dir: str | Path,
    title: str,
    sections: Sequence[Section],
    tables: Sequence[Table] = (),
    subtitle: str = "",
) -> Path:
    """Write `report.html` and one PNG file per figure into a folder.

    Parameters
    ----------
    out_dir : path
        Made where it does not exist; files of the same names are replaced, others left.
    title, subtitle : str
        At the top of the page.
    sections : sequence of Section
        The body.
    tables : sequence of Table
        Between title and first section.

    Returns
    -------
    Path
        Of the page.
    """
    from jinja2 import Environment, StrictUndefined

    folder = Path(out_dir)
    pictures = [picture for section in sections for picture in section.illustrations]
    names = [picture.name for picture in pictures]
    drawn = {picture.name: style.png(picture.figure) for picture in pictures}
    for name, data in drawn.items():
        write_atomic(folder / f"{name}.png", data)
    in_order = [*tables, *(table for section in sections for table in section.tables)]
    page = (files(__package__) / "report.html").read_text("utf-8")
    environment = Environment(autoescape=True, undefined=StrictUndefined)
    html = environment.from_string(page).render(
        title=title,
        subtitle=subtitle,
        tables=tables,
        sections=sections,
        data={name: base64.b64encode(data).decode("ascii") for name, data in drawn.items()},
        figure_numbers={name: index for index, name in enumerate(names, start=1)},
        numbers={table: index for index, table in enumerate(in_order, start=1)},
        footer=f"Isogal {isogal.__version__}. An isogal is a line of equal gravity.",
    )
    path = folder / "report.html"
    write_atomic(path, html)
    return path
