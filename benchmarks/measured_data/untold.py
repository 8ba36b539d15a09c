"""Lines matched with nothing told but the prior and the readings' noise, on the maps that come
with them."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from isogal.maps.field_map import FieldMap
from isogal.scenario import Matcher
from isogal.tracks.matching import Uncertainty, match_track
from isogal.tracks.track import fit_to_map
from measured_data.lines import MGAL, Line, clear_lake, scotland
from measured_data.matches import AWAY, WHOLE, Summary, bearings, row_of, summary_of

GRAVITY_SIGMA = 0.5 * MGAL
MAGNETIC_SIGMA = 2.0
"""nT."""
BATCH = 30


class Group(NamedTuple):
    """Lines that are matched alike."""

    field_map: FieldMap
    lines: Sequence[Line]
    sigma: float
    """Of the readings' white noise, in the map's unit."""
    directions: int
    length: int
    """Of a batch, readings."""


GROUPS = {
    "Clear Lake, 4 directions": (GRAVITY_SIGMA, 4, WHOLE),
    "Clear Lake, batches of 30, 2 directions": (GRAVITY_SIGMA, 2, BATCH),
    "Scotland, tie lines, 2 directions": (MAGNETIC_SIGMA, 2, WHOLE),
    "Scotland, flight lines, 2 directions": (MAGNETIC_SIGMA, 2, WHOLE),
}


def group_of(name: str, data: Path) -> Group:
    """Return one of `GROUPS` with its map and lines."""
    if name.startswith("Clear Lake"):
        field_map, lines, _ = clear_lake(data)
    else:
        field_map, flights, ties = scotland(data)
        lines = ties if "tie lines" in name else flights
    return Group(field_map, lines, *GROUPS[name])


def study_untold(data: Path) -> Iterator[tuple[str, Summary]]:
    """Yield summaries of all lines, whole and at Clear Lake in batches as well."""
    return ((name, matched(*group_of(name, data))) for name in GROUPS)


def matched(
    field_map: FieldMap,
    lines: Sequence[Line],
    sigma: float,
    directions: int,
    length: int,
    name: str = "pmht",
) -> Summary:
    """Return the summary of lines that are matched from some directions."""
    settings = Matcher(name=name, batch_length=length)
    rows = []
    for line in lines:
        for shift in bearings(directions):
            track, _ = fit_to_map(line.track(sigma, shift), field_map)
            matches = match_track(track, field_map, settings, Uncertainty(position=AWAY))
            rows += [row_of(line, match) for match in matches]
    return summary_of(rows)
