"""How the commands of ``isogal map`` describe maps and routes, print and write them."""

import math
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from isogal.cli.checks import NETCDF, output_file
from isogal.cli.options import written_file
from isogal.cli.tables import print_json, print_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from isogal.arrays import Array, Integers
    from isogal.maps.expected_accuracy import Stretches
    from isogal.maps.field_map import FieldMap
    from isogal.maps.tiled_map import ScalarMap


class Statistics(NamedTuple):
    """Of the values of a map, in its unit."""

    minimum: float
    maximum: float
    mean: float
    standard_deviation: float
    missing: float
    """Share of the nodes that have no value."""


Picture = Annotated[Path | None, written_file("FILE.png", "Draw a picture.", ".png")]
NetcdfOut = Annotated[
    Path,
    typer.Argument(metavar="OUT", callback=output_file(*NETCDF), help="NetCDF file to write."),
]


def draw(path: Path, figure: "Figure") -> None:
    """Write a figure as PNG file; raises InputError."""
    from isogal.evaluation.figures.style import png
    from isogal.files import write_atomic

    write_atomic(path, png(figure))


def save(
    field_map: "FieldMap", path: Path, as_json: bool, lines: Iterable[str] = (), **more: object
) -> None:
    """Write a map as NetCDF and say so, see `say_written`, whose parameters these are; raises
    InputError."""
    from isogal.maps.formats.netcdf_writing import write_netcdf

    write_netcdf(field_map, path)
    say_written(field_map, path, as_json, lines, **more)


def say_written(
    field_map: "FieldMap", path: Path, as_json: bool, lines: Iterable[str] = (), **more: object
) -> None:
    """Describe a map that was written: as JSON, with what else there is to say, or as a table with
    further lines; and where it is.

    Parameters
    ----------
    field_map : FieldMap
    path : Path
        File or folder.
    as_json : bool
    lines : iterable of str
        Below the table.
    more
        What else the JSON holds.
    """
    found = statistics(field_map)
    if as_json:
        print_json(describe_map(field_map, found) | more | {"file": str(path)})
    else:
        print_map(field_map, found, *lines, str(path))


def statistics(field_map: "ScalarMap") -> Statistics:
    """Return the statistics of a map's values: part by part and row by row, as the whole map, or a
    copy of it, may not fit into memory."""
    import numpy as np

    size, count, total, squares, low, high = 0, 0, 0.0, 0.0, math.inf, -math.inf
    middle = math.nan
    for row in (row for part in field_map.parts() for row in part.values):
        known = row[~np.isnan(row)].astype(np.float64)
        size += row.size
        if known.size:
            middle = middle if count else float(known[0])
            count += known.size
            total += float((known - middle).sum())
            squares += float(((known - middle) ** 2).sum())
            low, high = min(low, float(known.min())), max(high, float(known.max()))
    mean = total / count
    spread = math.sqrt(max(squares / count - mean**2, 0.0))
    return Statistics(low, high, middle + mean, spread, 1.0 - count / size)


def describe_map(field_map: "ScalarMap", found: Statistics) -> dict[str, object]:
    """Return what a map is of, its extent (deg) and nodes, and its statistics, for JSON."""
    import numpy as np

    extent = field_map.extent
    return {
        "provenance": field_map.provenance,
        "quantity": field_map.quantity,
        "unit": field_map.unit,
        "file_unit": field_map.file_unit or field_map.unit,
        **dict(
            zip(("south", "north", "west", "east"), np.degrees(extent[:4]).tolist(), strict=True)
        ),
        "nodes": field_map.shape,
        "step_deg": np.degrees(field_map.step).tolist(),
        "cell_m": field_map.cell_size_m(0.5 * (extent.south + extent.north)),
        **found._asdict(),
        "sigma": float(np.nanmedian(field_map.sigma)),
        "correlation_length": field_map.correlation_length,
        "quantisation": field_map.quantisation,
        "height": field_map.height,
    }


def rows_of(columns: "Mapping[str, Array | Integers]") -> list[dict[str, float | None]]:
    """Return rows of columns (K,) as JSON can hold them: None where a number is infinite or
    missing."""
    return [
        {name: one if math.isfinite(one) else None for name, one in zip(columns, row, strict=True)}
        for row in zip(*(column.tolist() for column in columns.values()), strict=True)
    ]


def shown_unit(unit: str) -> tuple[float, str]:
    """Return the factor and the unit in which differences of a map's values are shown."""
    return (1e5, "mGal") if unit == "m/s²" else (1.0, unit)


def _shown(value: float, unit: str) -> str:
    """Return a value with its unit, accelerations below 0.1 m/s² in mGal."""
    if unit == "m/s²":
        return f"{value * 1e5:.4g} mGal" if abs(value) < 0.1 else f"{value:.6f} m/s²"
    return f"{value:.5g} {unit}"


def print_map(field_map: "ScalarMap", found: Statistics, *below: str) -> None:
    """Print what a map is of, and its statistics, as a table, and lines below it."""
    import numpy as np

    show = partial(_shown, unit=field_map.unit)
    extent, (rows, columns) = field_map.extent, field_map.shape
    height, width = np.degrees(field_map.step)
    tall, wide = field_map.cell_size_m(0.5 * (extent.south + extent.north))
    south, north, west, east = np.degrees(extent[:4])
    quantity, sigma = field_map.quantity.replace("_", " "), float(np.nanmedian(field_map.sigma))
    table = {
        "quantity": f"{quantity} in {field_map.unit} (file:"
        f" {field_map.file_unit or field_map.unit})",
        "latitude": f"{south:.4f} to {north:.4f} deg",
        "longitude": f"{west:.4f} to {east:.4f} deg",
        "nodes": (
            f"{rows} x {columns}, {height:.5g} x {width:.5g} deg ({tall:.0f} x {wide:.0f} m)"
        ),
        "values": f"{show(found.minimum)} to {show(found.maximum)}, mean {show(found.mean)}",
        "standard deviation": show(found.standard_deviation),
        "missing": f"{100 * found.missing:.2g} %",
        "1-sigma error": show(sigma) if sigma else "not said",
        "step of the values": show(field_map.quantisation) if field_map.quantisation else "none",
        "level": "not said" if field_map.height is None else f"{field_map.height:g} m",
    }
    print_table(("map", field_map.provenance), list(table.items()), *below, words=(0, 1))


class AlongRoute(NamedTuple):
    """What a map has along a route, in its unit, and (S,) of its stretches each."""

    length_km: float
    value_rms: float
    value_standard_deviation: float
    gradient_rms: float
    """Per m."""
    stretches: "list[dict[str, float | None]]"
    """None where infinite or missing, as of a stretch that gives no fix."""

    @classmethod
    def of(
        cls, field_map: "ScalarMap", track: "tuple[Array, Array]", stretches: "Stretches"
    ) -> "AlongRoute":
        """Return values, gradient and expected accuracy along a track (K,), (K,) rad, stretch by
        stretch."""
        import numpy as np

        value, north, east = field_map.value_and_gradient(*track)
        best, worst = stretches.axes
        columns = {
            "from_km": stretches.start / 1e3,
            "to_km": stretches.end / 1e3,
            "latitude": np.degrees(stretches.latitude),
            "longitude": np.degrees(stretches.longitude),
            "readings": stretches.readings,
            "gradient_rms": stretches.gradient,
            "sigma_best": best,
            "sigma_worst": worst,
        }
        return cls(
            float(stretches.end[-1]) / 1e3,
            float(np.sqrt(np.mean(value**2))),
            float(np.std(value)),
            float(np.sqrt(np.mean(north**2 + east**2))),
            rows_of(columns),
        )

    def print(self, unit: str, *below: str) -> None:
        """Print the stretches as a table, and lines below it; the map is in this unit."""
        factor, short = shown_unit(unit)
        slope, per_km = 1e3 * factor, f"{short}/km"

        def texts(row: "dict[str, float | None]") -> list[str]:
            start, end, latitude, longitude, readings, gradient, *sigmas = row.values()
            return [
                f"{start:.0f}–{end:.0f}",
                f"{latitude:.3f}",
                f"{longitude:.3f}",
                str(readings),
                "none" if gradient is None else f"{slope * gradient:.3g}",
                *("no fix" if sigma is None else f"{sigma:,.0f}" for sigma in sigmas),
            ]

        print_table(
            ("km", "latitude", "longitude", "readings", per_km, "best (m)", "worst (m)"),
            [texts(row) for row in self.stretches],
            f"{self.length_km:.1f} km; values {_shown(self.value_standard_deviation, unit)}"
            f" standard deviation, gradient {slope * self.gradient_rms:.3g} {per_km} RMS",
            *below,
            title=f"Gradient ({per_km}) and expected 1-sigma of a fix from each stretch alone",
            words=(),
        )
