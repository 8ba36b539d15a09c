"""Descriptions of maps and routes: dictionaries for JSON, and tables."""

import math
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.cli.tables import print_table
from isogal.maps.expected_accuracy import Stretches
from isogal.maps.tiled_map import ScalarMap


def describe_map(field_map: ScalarMap) -> dict[str, Any]:
    """Return what a map is of, its extent and nodes, and the statistics of its values."""
    extent, step = field_map.extent, field_map.step
    size, count, total, squares, low, high = 0, 0, 0.0, 0.0, math.inf, -math.inf
    middle: float | None = None
    # part by part and row by row: the whole map, or a copy of it, may not fit into memory
    for row in (row for part in field_map.parts() for row in part.values):
        known = row[~np.isnan(row)].astype(np.float64)
        size += row.size
        if known.size:
            middle = float(known[0]) if middle is None else middle
            count += known.size
            total += float((known - middle).sum())
            squares += float(((known - middle) ** 2).sum())
            low, high = min(low, float(known.min())), max(high, float(known.max()))
    assert middle is not None  # a map has values
    mean = total / count
    sigma = (
        field_map.sigma
        if isinstance(field_map.sigma, float)
        else float(np.nanmedian(field_map.sigma))
    )
    return {
        "provenance": field_map.provenance,
        "quantity": field_map.quantity,
        "unit": field_map.unit,
        "file_unit": field_map.file_unit or field_map.unit,
        "south": math.degrees(extent.south),
        "north": math.degrees(extent.north),
        "west": math.degrees(extent.west),
        "east": math.degrees(extent.east),
        "nodes": list(field_map.shape),
        "step_deg": [math.degrees(width) for width in step],
        "cell_m": list(field_map.cell_size_m(0.5 * (extent.south + extent.north))),
        "minimum": low,
        "maximum": high,
        "mean": middle + mean,
        "standard_deviation": math.sqrt(max(squares / count - mean**2, 0.0)),
        "missing": 1.0 - count / size,
        "sigma": sigma,
        "correlation_length": field_map.correlation_length,
        "quantisation": field_map.quantisation,
        "height": field_map.height,
    }


def describe_route(
    field_map: ScalarMap, track: tuple[Array, Array], stretches: Stretches
) -> dict[str, Any]:
    """Return values, gradient and expected accuracy along a track, stretch by stretch; infinite
    and missing numbers become None.

    Parameters
    ----------
    field_map : ScalarMap
    track : (K,), (K,) rad
        Latitude and longitude of the readings.
    stretches : Stretches
        Of the track.
    """
    value, north, east = field_map.value_and_gradient(*track)
    best, worst = stretches.axes
    parts = [
        {
            "from_km": stretches.start[i] / 1e3,
            "to_km": stretches.end[i] / 1e3,
            "latitude": math.degrees(stretches.latitude[i]),
            "longitude": math.degrees(stretches.longitude[i]),
            "readings": int(stretches.readings[i]),
            "gradient_rms": finite_or_none(stretches.gradient[i]),
            "sigma_best": finite_or_none(best[i]),
            "sigma_worst": finite_or_none(worst[i]),
        }
        for i in range(stretches.start.size)
    ]
    return {
        "length_km": float(stretches.end[-1]) / 1e3,
        "value_rms": float(np.sqrt(np.mean(value**2))),
        "value_standard_deviation": float(np.std(value)),
        "gradient_rms": float(np.sqrt(np.mean(north**2 + east**2))),
        "stretches": parts,
    }


def finite_or_none(number: float) -> float | None:
    """Return a number as JSON can hold it: None where it is infinite or missing."""
    return float(number) if math.isfinite(number) else None


def print_map(found: dict[str, Any], *below: str) -> None:
    """Print a description as a table, and lines below it."""
    show = _writer(found["unit"])
    (rows, columns), (height, width) = found["nodes"], found["step_deg"]
    tall, wide = found["cell_m"]
    quantity = found["quantity"].replace("_", " ")
    table = {
        "quantity": f"{quantity} in {found['unit']} (file: {found['file_unit']})",
        "latitude": f"{found['south']:.4f} to {found['north']:.4f} deg",
        "longitude": f"{found['west']:.4f} to {found['east']:.4f} deg",
        "nodes": (
            f"{rows} x {columns}, {height:.5g} x {width:.5g} deg ({tall:.0f} x {wide:.0f} m)"
        ),
        "values": (
            f"{show(found['minimum'])} to {show(found['maximum'])}, mean {show(found['mean'])}"
        ),
        "standard deviation": show(found["standard_deviation"]),
        "missing": f"{100 * found['missing']:.2g} %",
        "1-sigma error": show(found["sigma"]) if found["sigma"] else "not said",
        "step of the values": show(found["quantisation"]) if found["quantisation"] else "none",
        "level": "not said" if found["height"] is None else f"{found['height']:g} m",
    }
    print_table(("map", found["provenance"]), list(table.items()), *below, words=(0, 1))


def print_route(found: dict[str, Any], unit: str, *below: str) -> None:
    """Print the stretches of a track as a table, and lines below it."""
    factor, slope_unit = (1e8, "mGal/km") if unit == "m/s²" else (1e3, f"{unit}/km")
    print_table(
        ("km", "latitude", "longitude", "readings", slope_unit, "best (m)", "worst (m)"),
        [
            (
                f"{part['from_km']:.0f}–{part['to_km']:.0f}",
                f"{part['latitude']:.3f}",
                f"{part['longitude']:.3f}",
                str(part["readings"]),
                "none" if part["gradient_rms"] is None else f"{factor * part['gradient_rms']:.3g}",
                _metres(part["sigma_best"]),
                _metres(part["sigma_worst"]),
            )
            for part in found["stretches"]
        ],
        f"{found['length_km']:.1f} km; values {_writer(unit)(found['value_standard_deviation'])}"
        f" standard deviation, gradient {factor * found['gradient_rms']:.3g} {slope_unit} RMS",
        *below,
        title=f"Gradient ({slope_unit}) and expected 1-sigma of a fix from each stretch alone",
        words=(),
    )


def _metres(sigma: float | None) -> str:
    return "no fix" if sigma is None else f"{sigma:,.0f}"


def _writer(unit: str) -> Any:
    """Return a function that writes a value with its unit, accelerations below 0.1 m/s² in
    mGal."""

    def write(value: float) -> str:
        if unit == "m/s²":
            return f"{value * 1e5:.4g} mGal" if abs(value) < 0.1 else f"{value:.6f} m/s²"
        return f"{value:.5g} {unit}"

    return write
