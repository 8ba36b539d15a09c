"""``isogal map variability``: how much does a map vary around each reading along a route?"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple

import typer

from isogal.cli.checks import finite
from isogal.cli.map.info import ASSUMED
from isogal.cli.map.part import RouteChoice
from isogal.cli.map.results import Picture, draw, print_json
from isogal.cli.map_choice import MapChoice
from isogal.cli.option_groups import with_groups
from isogal.cli.options import Json
from isogal.cli.tables import print_table

if TYPE_CHECKING:
    from isogal.arrays import Array
    from isogal.maps.tiled_map import ScalarMap


class _Along(NamedTuple):
    """Variability along a track; (K,) each."""

    distance: "Array"
    """m from the first reading."""
    latitude: "Array"
    """rad."""
    longitude: "Array"
    """rad."""
    variability: "Array"
    """C (paper eq. CV), unit of the map squared."""
    normalised: "Array"


@dataclass(frozen=True)
class Template:
    """The window template round each reading, and how the variability is normalised."""

    PANEL: ClassVar[str] = ASSUMED

    half_width: Annotated[
        float, typer.Option(metavar="M", min=1.0, callback=finite, help="Of the window template.")
    ] = 2000.0
    points: Annotated[int, typer.Option(min=3, help="Along each side of the template, odd.")] = 9
    samples: Annotated[
        int, typer.Option(min=1, help="Places that the normalisation looks back over.")
    ] = 100

    def along(self, field_map: "ScalarMap", track: "tuple[Array, Array]") -> _Along:
        """Return the variability along a track (latitude, longitude, rad); raises InputError."""
        from isogal.maps.corridor import along_track
        from isogal.maps.variability import feature_variability, normalised_variability

        variability = feature_variability(field_map, *track, self.half_width, self.points)
        normalised = normalised_variability(variability, self.samples)
        return _Along(along_track(*track), *track, variability, normalised)


@with_groups
def variability(
    map_: MapChoice,
    where: RouteChoice,
    template: Template,
    figure: Picture = None,
    json: Json = False,
) -> None:
    """Compute the map feature variability (paper eq. CV) at each reading along a route."""
    route = where.build()
    field_map = map_.load_along(route.around(where.margin), route.measured)
    found = template.along(field_map, route.readings_on(field_map))
    if figure is not None:
        from isogal.cli.map.figures import variability_figure

        value = field_map.value(found.latitude, found.longitude)
        curves = value, found.variability, found.normalised
        draw(figure, variability_figure(field_map, found.distance, *curves))
    if json:
        print_json(_as_json(field_map, template, found))
    else:
        _print(field_map, found, figure)


def _as_json(field_map: "ScalarMap", template: Template, found: _Along) -> dict[str, Any]:
    import numpy as np

    from isogal.cli.map.description import finite_or_none

    columns = {
        "distance_km": found.distance / 1e3,
        "latitude": np.degrees(found.latitude),
        "longitude": np.degrees(found.longitude),
        "variability": found.variability,
        "normalised": found.normalised,
    }
    return {
        "quantity": field_map.quantity,
        "unit": f"({field_map.unit})²",
        "half_width": template.half_width,
        "points": template.points,
        "samples": template.samples,
        "places": [
            dict(zip(columns, map(finite_or_none, row), strict=True))
            for row in zip(*columns.values(), strict=True)
        ],
    }


def _print(field_map: "ScalarMap", found: _Along, figure: Path | None) -> None:
    import numpy as np

    factor, unit = (1e5, "mGal") if field_map.unit == "m/s²" else (1.0, field_map.unit)
    rows = []
    for first in range(0, found.distance.size, 50):
        part = slice(first, min(first + 50, found.distance.size))
        kilometres = found.distance[part] / 1e3
        row = [f"{kilometres[0]:.0f} to {kilometres[-1]:.0f}"]
        known = np.isfinite(found.variability[part])
        if known.any():
            root = factor * np.sqrt(np.mean(found.variability[part][known]))
            row += [f"{root:.3g}", f"{np.mean(found.normalised[part][known]):.3g}"]
        rows.append(row)
    print_table(
        ("km", f"root of C ({unit})", "normalised"),
        rows,
        *([str(figure)] if figure is not None else ()),
        title=f"Map feature variability of {field_map.provenance}",
        words=(),
    )
