"""How the commands of ``isogal map`` describe maps and routes, print and write them."""

import math
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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


Described = dict[str, Any]
"""Numbers and texts by name, as JSON shows them."""
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
    field_map: "FieldMap",
    path: Path,
    as_json: bool,
    lines: Iterable[str] = (),
    variable: str | None = None,
    **more: object,
) -> None:
    """Write a map as NetCDF and describe it: as JSON, with what else there is to say, or as a
    table with further lines; and where it is. Raises InputError.

    Parameters
    ----------
    field_map : FieldMap
    path : Path
    as_json : bool
    lines : iterable of str
        Below the table.
    variable : str, optional
        Its name in the file; default: by its quantity.
    more
        What else the JSON holds.
    """
    from isogal.maps.formats.netcdf_writing import write_netcdf

    write_netcdf(field_map, path, variable)
    described = describe_map(field_map)
    if as_json:
        print_json(described | more | {"file": str(path)})
    else:
        print_map(described, *lines, str(path))


def statistics(field_map: "ScalarMap") -> dict[str, float]:
    """Return the statistics of a map's values, and the share of the nodes that have none: part by
    part and row by row, as the whole map, or a copy of it, may not fit into memory."""
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
    return {
        "minimum": low,
        "maximum": high,
        "mean": middle + mean,
        "standard_deviation": math.sqrt(max(squares / count - mean**2, 0.0)),
        "missing": 1.0 - count / size,
    }


def describe_map(field_map: "ScalarMap") -> Described:
    """Return what a map is of, its extent (deg) and nodes, and its statistics."""
    import numpy as np

    extent = field_map.extent
    edges = np.degrees(extent[:4]).tolist()
    return {
        "provenance": field_map.provenance,
        "quantity": field_map.quantity,
        "unit": field_map.unit,
        "file_unit": field_map.file_unit or field_map.unit,
        **dict(zip(("south", "north", "west", "east"), edges, strict=True)),
        "nodes": field_map.shape,
        "step_deg": np.degrees(field_map.step).tolist(),
        "cell_m": field_map.cell_size_m(0.5 * (extent.south + extent.north)),
        **statistics(field_map),
        "sigma": float(np.nanmedian(field_map.sigma)),
        "correlation_length": field_map.correlation_length,
        "quantisation": field_map.quantisation,
        "height": field_map.height,
    }


def print_map(described: Described, *below: str) -> None:
    """Print what `describe_map` returns as a table, and lines below it."""
    show = partial(_shown, unit=described["unit"])
    shown = described | {
        name: show(described[name])
        for name in ("minimum", "maximum", "mean", "standard_deviation", "sigma", "quantisation")
    }
    texts = {
        "quantity": "{quantity} in {unit} (file: {file_unit})",
        "latitude": "{south:.4f} to {north:.4f} deg",
        "longitude": "{west:.4f} to {east:.4f} deg",
        "nodes": "{nodes[0]} x {nodes[1]}, {step_deg[0]:.5g} x {step_deg[1]:.5g} deg"
        " ({cell_m[0]:.0f} x {cell_m[1]:.0f} m)",
        "values": "{minimum} to {maximum}, mean {mean}",
        "standard deviation": "{standard_deviation}",
        "missing": "{missing:.2%}",
        "1-sigma error": "{sigma}" if described["sigma"] else "not said",
        "step of the values": "{quantisation}" if described["quantisation"] else "none",
        "level": "not said" if described["height"] is None else "{height:g} m",
    }
    table = [(name, text.format(**shown)) for name, text in texts.items()]
    print_table(("map", described["provenance"]), table, *below, words=(0, 1))


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


def describe_route(
    field_map: "ScalarMap",
    track: "tuple[Array, Array]",
    stretches: "Stretches",
    height: float | None = None,
) -> Described:
    """Return values, gradient (map's unit, per m) and expected accuracy (m) of fixes along a track
    (K,), (K,) rad, stretch by stretch; None where infinite or missing, as of a stretch that gives
    no fix. `height` (m) is that which the map has been continued to; None = it is as it was."""
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
    return {
        "length_km": float(stretches.end[-1]) / 1e3,
        "continued_to": height,
        "value_rms": float(np.sqrt(np.mean(value**2))),
        "value_standard_deviation": float(np.std(value)),
        "gradient_rms": float(np.sqrt(np.mean(north**2 + east**2))),
        "stretches": rows_of(columns),
    }


def print_route(described: Described, unit: str, *below: str) -> None:
    """Print what `describe_route` returns of a map in this unit as a table, and lines below it."""
    factor, short = shown_unit(unit)
    height = described["continued_to"]
    level = "on the map's level" if height is None else f"at route.height {height:g} m"
    slope, per_km = 1e3 * factor, f"{short}/km"
    rows = []
    for row in described["stretches"]:
        gradient, sigmas = row["gradient_rms"], (row["sigma_best"], row["sigma_worst"])
        rows.append(
            [
                "{from_km:.0f}–{to_km:.0f}".format(**row),
                *(f"{row[name]:.3f}" for name in ("latitude", "longitude")),
                str(row["readings"]),
                "none" if gradient is None else f"{slope * gradient:.3g}",
                *("no fix" if sigma is None else f"{sigma:,.0f}" for sigma in sigmas),
            ]
        )
    print_table(
        ("km", "latitude", "longitude", "readings", per_km, "best (m)", "worst (m)"),
        rows,
        f"{described['length_km']:.1f} km; values"
        f" {_shown(described['value_standard_deviation'], unit)} standard deviation, gradient"
        f" {slope * described['gradient_rms']:.3g} {per_km} RMS",
        *below,
        title=f"Gradient ({per_km}) and expected 1-sigma of a fix from each stretch alone,"
        f" {level}",
        words=(),
    )
