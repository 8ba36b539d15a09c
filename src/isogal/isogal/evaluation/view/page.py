"""The file: one page, with its script, its style, Bokeh's script and its data in it."""

import json
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import isogal
from isogal.earth.plane import Plane
from isogal.errors import InputError
from isogal.evaluation.consistency import chi_square_interval
from isogal.evaluation.figures.style import FieldScale, field_scale
from isogal.evaluation.view.background import background
from isogal.evaluation.view.figures import MAPS, drawings
from isogal.evaluation.view.payload import payload
from isogal.evaluation.view.record import ViewedRun
from isogal.files import write_atomic
from isogal.maps.channels import channels_of

if TYPE_CHECKING:
    from jinja2 import Template

    from isogal.arrays import Array
    from isogal.maps.channels import RouteMap


@dataclass(frozen=True, slots=True)
class Frame:
    """What of a page stays as it is while its numbers change."""

    plane: Plane
    scale: FieldScale
    html: str
    """The page, but for its numbers."""

    @staticmethod
    def of(
        title: str,
        subtitle: str,
        end: float,
        route: tuple["Array", "Array"],
        field_map: "RouteMap",
        live: bool = False,
    ) -> "Frame":
        """Draw the map and the empty panels.

        Parameters
        ----------
        end : float
            h, of the axis of time.
        route : pair of (K,) arrays
            Latitude and longitude of the true track, rad.
        live : bool
            Whether the page asks its server for new numbers.

        Raises
        ------
        InputError
            Bokeh is not installed.
        """
        require_bokeh()
        from bokeh.embed import components

        latitude, longitude = route[0], np.unwrap(route[1])
        shown = channels_of(field_map)[0]
        # whatever is drawn at one place is stretched alike: by 2 % one degree off the middle at 37
        middle = 0.5 * float(latitude.min() + latitude.max())
        plane, scale = Plane.at(latitude[0], longitude[0], middle), field_scale(shown)
        # the page has no mathematics
        unit = scale.unit_name.replace("$10^{-5}$ m/s²", "mGal")
        back = background(shown, plane, (latitude, longitude), scale)
        drawn = drawings(back, (scale.name, unit), end, chi_square_interval(1, 2))
        script, divisions = components({drawing.name: drawing.plot for drawing in drawn})
        lines = f"Lines of equal value every {back.coarse.step:g}"
        if back.fine.x.size:
            lines += f", near the route {back.fine.step:g}"
        html = _template().render(
            title=title,
            subtitle=subtitle,
            script=script,
            drawings=drawn,
            divisions=divisions,
            maps=MAPS,
            live=live,
            lines=f"{lines} {unit}.",
            version=isogal.__version__,
        )
        return Frame(plane, scale, html)

    def payload(self, viewed: ViewedRun) -> str:
        """Return the numbers of a run as JSON."""
        return json.dumps(
            payload(viewed, self.plane, self.scale), separators=(",", ":"), allow_nan=False
        )

    def page(self, viewed: ViewedRun | None) -> str:
        """Return the whole page; without numbers where there is no run yet."""
        data = "null" if viewed is None else self.payload(viewed)
        return self.html.replace("@DATA@", data.replace("</", "<\\/"))


def write_view(path: str | Path, viewed: ViewedRun, field_map: "RouteMap") -> Path:
    """Write the page of one run; return its path.

    Raises
    ------
    InputError
        Bokeh is not installed, or the file cannot be written.
    """
    runs = viewed.runs
    end, route = float(runs.elapsed[-1]) / 3600.0, (runs.latitude, runs.longitude)
    frame = Frame.of(viewed.title, viewed.subtitle, end, route, field_map)
    write_atomic(path, frame.page(viewed))
    return Path(path)


def require_bokeh() -> None:
    """Raise InputError where Bokeh, which draws the page, is not installed."""
    from importlib.util import find_spec

    if find_spec("bokeh") is None:
        raise InputError("the page needs the Python package bokeh: pip install 'isogal[view]'")


def _template() -> "Template":
    """Return the page, with everything in it that is the same in all."""
    from bokeh.resources import Resources
    from jinja2 import Environment

    own = files(__package__)
    html, css, js = ((own / f"view.{kind}").read_text("utf-8") for kind in ("html", "css", "js"))
    library = Resources(mode="inline", components=["bokeh"], log_level="warn").render_js()
    shared = {"library": library, "style": css, "own_script": js}
    return Environment(autoescape=True).from_string(html, globals=shared)
