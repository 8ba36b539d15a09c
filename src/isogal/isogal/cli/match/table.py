"""The fixes of a track as text."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from isogal.matching.interfaces import Fix
    from isogal.tracks.matching import Match


def print_table(matches: "Sequence[Match]", line: str | None = None) -> None:
    """Print one row for each batch of a track (or of a line of its file), and how many of them
    gave a fix."""
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, header_style="bold")
    for name in ("time (s)", "latitude", "longitude", "1-sigma (m)"):
        table.add_column(name, justify="right")
    table.add_column("")
    for match in matches:
        table.add_row(*_cells(match.fix))
    console = Console(highlight=False, soft_wrap=True)
    if line is not None:
        console.print(f"line {line}")
    console.print(table)
    published = sum(m.fix.published for m in matches)
    failed = sum(m.fix.failed for m in matches)
    words = f"; the matcher failed on {failed} of them" if failed else ""
    console.print(f"{published} fixes of {len(matches)} batches{words}")
    if published < len(matches):
        console.print(
            "no fix: longer batches (--batch-length all), tracks with true positions near by"
            " (--reference), or --map-sigma auto where another was told may help"
        )


def _cells(fix: "Fix") -> list[str]:
    import numpy as np

    time = f"{fix.time:.10g}"
    if not fix.published:
        return [time, "-", "-", "-", f"no fix: {fix.reason}"]
    short, long = np.sqrt(np.linalg.eigvalsh(fix.covariance))
    place = (f"{np.degrees(angle):.5f}" for angle in (fix.latitude, fix.longitude))
    return [time, *place, f"{long:.0f} x {short:.0f}", ""]
