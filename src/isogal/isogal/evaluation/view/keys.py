"""What the page says beside a figure: its title, and the key of its lines. Both are text of the
page and no part of the drawing, so that they fold on a narrow page."""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Key:
    """An entry of a key, which hides what it names when it is clicked."""

    name: str
    """Of what is drawn, alone in the page."""
    label: str
    colour: str
    kind: str = "line"
    """line, dash, dots, disc or area."""


@dataclass(slots=True)
class Drawing:
    """A figure with its texts."""

    plot: Any
    """Bokeh figure."""
    title: str
    keys: list[Key] = field(default_factory=list)

    @property
    def name(self) -> str:
        """The figure's name."""
        return str(self.plot.name)

    def line(self, y: str, label: str, colour: str, *, x: str = "t", **options: Any) -> Any:
        """Draw a line; with a label it gets an entry of the key."""
        dashes = options.get("line_dash", "solid")
        kind = {"solid": "line", "dashed": "dash", "dotted": "dots"}[dashes]
        name = self.key(y, label, colour, kind)
        return self.plot.line(x, y, line_color=colour, name=name, **options)

    def key(self, what: str, label: str, colour: str, kind: str) -> str:
        """Add an entry of the key; return the name that what is drawn must have."""
        name = f"{self.name}.{what}"
        self.keys.append(Key(name, label, colour, kind))
        return name
