"""``isogal map info`` and ``variability``: what is a map, how good can fixes be along a route, and
how much does the map vary around each reading?"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from isogal.cli.checks import positive
from isogal.cli.map.part import PartChoice, Route, RouteChoice
from isogal.cli.map.results import (
    Described,
    Picture,
    describe_map,
    describe_route,
    draw,
    print_map,
    print_route,
    rows_of,
    shown_unit,
)
from isogal.cli.map_choice import MapChoice
from isogal.cli.option_groups import with_groups
from isogal.cli.options import Json, number, text
from isogal.cli.tables import print_json, print_table
from isogal.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from isogal.arrays import Array
    from isogal.maps.expected_accuracy import Stretches
    from isogal.maps.tiled_map import ScalarMap

ASSUMED = "What is assumed"


@dataclass(frozen=True)
class Assumptions:
    """What the expected accuracy of fixes depends on."""

    PANEL: ClassVar[str] = ASSUMED

    stretch: Annotated[float, number("Track that a fix is made from.", "KM", least=0.1)] = 5.0
    sensor_sigma: Annotated[
        str | None,
        text("SIGMA", "1-sigma of a reading, SI (nT) or as 0.5mGal; default: gravimeter.sigma."),
    ] = None
    map_sigma: Annotated[
        str | None,
        text(
            "SIGMA",
            "1-sigma of the map, likewise; default: as the map says, map_error.sigma at least.",
        ),
    ] = None
    map_correlation_length: Annotated[
        float | None,
        number("Of the map's error; default: as the map says, else map_error's.", "M", positive),
    ] = None
    bias_sigma: Annotated[
        str, text("SIGMA", "1-sigma of an unknown offset of the readings, likewise.")
    ] = "0"

    def stretches(
        self, field_map: "ScalarMap", route: Route, track: "tuple[Array, Array]"
    ) -> "Stretches":
        """Return what readings along a track (latitude, longitude, rad) tell, stretch by stretch;
        raises InputError."""
        import numpy as np

        from isogal.cli.sigmas import parse_sigma
        from isogal.fields.measured import measured_field, reading_sigma
        from isogal.maps.expected_accuracy import Errors, position_information

        settings = route.settings
        if self.sensor_sigma is None and measured_field(settings).unit != field_map.unit:
            raise InputError(
                f"--sensor-sigma: must be given for a map in {field_map.unit}, or --set field=..."
                " and --set gravimeter.sigma=..."
            )
        true, said = settings.true, field_map.correlation_length
        if np.nanmedian(field_map.sigma) < true.map_error.sigma:
            said = None
        sensor = parse_sigma(self.sensor_sigma, "--sensor-sigma", field_map, 1.0, zero=False)
        errors = Errors(
            reading_sigma(true) if sensor is None else sensor,
            parse_sigma(self.map_sigma, "--map-sigma", field_map, 1.0),
            self.map_correlation_length or said or true.map_error.correlation_length,
            parse_sigma(self.bias_sigma, "--bias-sigma", field_map, 1.0) or 0.0,
            true.map_error.sigma,
        )
        return position_information(field_map, *track, errors, 1e3 * self.stretch)


@with_groups
def info(
    map_: MapChoice,
    where: PartChoice,
    assumed: Assumptions,
    figure: Picture = None,
    json: Json = False,
) -> None:
    """Say what a map is; with a route (--scenario, --set or --route), how good fixes can be along
    it.

    The expected accuracy is the bound on a fix from the readings of one stretch alone, for a
    position already known to within the linear range of the map, at route.height as in a run. The
    navigator's error (`isogal montecarlo`) is another: it adds what the INS and all fixes know."""
    needed = map_.is_synthetic and where.window is None
    route = where.build() if needed else where.build_if_asked()
    field_map = map_.load_part(where.part(route), route.measured if route else "gravity")
    described, track, stretches, along = describe_map(field_map), None, None, None
    if route is not None:
        track, stretches, along = _along(map_, field_map, route, where.margin, assumed)
    if figure is not None:
        from isogal.cli.map.figures import map_figure

        draw(figure, map_figure(field_map, track, stretches))
    files = [str(figure)] if figure is not None else []
    if json:
        print_json(described | ({"route": along} if along else {}))
        return
    print_map(described, *([] if along else files))
    if along is not None:
        print_route(along, field_map.unit, *files)


def _along(
    map_: MapChoice, field_map: "ScalarMap", route: Route, margin: float, assumed: Assumptions
) -> "tuple[tuple[Array, Array], Stretches, Described]":
    """Return where readings along a route are (rad), what they tell, and both described, by the
    map at the height of the flight; raises InputError where that does not cover it."""
    source = map_.given(route.settings, route.measured)
    flown = source.flown_along(route.settings.route.height, field_map, route.around(margin))
    try:
        track = route.readings_on(flown)
    except InputError as error:
        raise InputError(f"{error}; --set map.continuation=none takes it as it is") from None
    stretches = assumed.stretches(flown, route, track)
    height = None if flown is field_map else route.settings.route.height
    return track, stretches, describe_route(flown, track, stretches, height)


@dataclass(frozen=True)
class Template:
    """The window template round each reading, and how the variability is normalised."""

    PANEL: ClassVar[str] = ASSUMED

    half_width: Annotated[float, number("Of the window template.", "M", least=1.0)] = 2000.0
    points: Annotated[int, number("Along each side of the template, odd.", least=3)] = 9
    samples: Annotated[int, number("Places that the normalisation looks back over.", least=1)] = (
        100
    )

    def along(self, field_map: "ScalarMap", track: "tuple[Array, Array]") -> "dict[str, Array]":
        """Return what is said of each reading along a track (latitude, longitude, rad), by column,
        (K,) each; raises InputError."""
        import numpy as np

        from isogal.maps.corridor import along_track
        from isogal.maps.variability import feature_variability, normalised_variability

        variability = feature_variability(field_map, *track, self.half_width, self.points)
        return {
            "distance_km": along_track(*track) / 1e3,
            "latitude": np.degrees(track[0]),
            "longitude": np.degrees(track[1]),
            "variability": variability,
            "normalised": normalised_variability(variability, self.samples),
        }


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
    field_map = map_.load_part(route.around(where.margin), route.measured)
    track = route.readings_on(field_map)
    found = template.along(field_map, track)
    if figure is not None:
        draw(figure, _drawn(field_map, track, found))
    if json:
        units = {"quantity": field_map.quantity, "unit": f"({field_map.unit})²"}
        print_json(units | vars(template) | {"places": rows_of(found)})
    else:
        _print(field_map, found, figure)


def _drawn(
    field_map: "ScalarMap", track: "tuple[Array, Array]", found: "dict[str, Array]"
) -> "Figure":
    from isogal.evaluation.figures.signal import variability_along

    curves = field_map.value(*track), found["variability"], found["normalised"]
    picture = variability_along(field_map, found["distance_km"], *curves)
    picture.axes[-1].set_xlabel("distance along the track (km)")
    return picture


def _print(field_map: "ScalarMap", found: "dict[str, Array]", figure: Path | None) -> None:
    """Print a row for each 50 readings."""
    import numpy as np

    factor, unit = shown_unit(field_map.unit)
    rows, every = [], [found[name] for name in ("distance_km", "variability", "normalised")]
    for first in range(0, found["distance_km"].size, 50):
        kilometres, variability, normalised = (one[first : first + 50] for one in every)
        row = [f"{kilometres[0]:.0f} to {kilometres[-1]:.0f}"]
        known = np.isfinite(variability)
        if known.any():
            root = factor * np.sqrt(np.mean(variability[known]))
            row += [f"{root:.3g}", f"{np.mean(normalised[known]):.3g}"]
        rows.append(row)
    print_table(
        ("km", f"root of C ({unit})", "normalised"),
        rows,
        *([str(figure)] if figure is not None else ()),
        title=f"Map feature variability of {field_map.provenance}",
        words=(),
    )
