"""The report of a calibration flight: a page with a figure and tables."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from isogal.arrays import Array
from isogal.evaluation.figures import style
from isogal.evaluation.html_report import Illustration, Section, Table, number, write_report
from isogal.magnetics.calibration import Calibration
from isogal.magnetics.flight import MagneticFlight
from isogal.magnetics.terms import names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SECTORS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")


def by_heading(heading: Array, residual: Array) -> Array:
    """Return (8,) the mean of residuals (N,) on headings (N,; rad) around north, north-east, ...;
    NaN where there are none."""
    sector = np.round(heading / (2.0 * np.pi) * len(_SECTORS)).astype(int) % len(_SECTORS)
    known = np.isfinite(residual)
    counts = np.bincount(sector[known], minlength=len(_SECTORS))
    with np.errstate(invalid="ignore"):
        return np.bincount(sector[known], residual[known], len(_SECTORS)) / counts


def summary(flight: MagneticFlight, found: Calibration) -> dict[str, Any]:
    """Return what was found as numbers: nT, s, deg."""
    compensation = found.compensation
    own = compensation.own_field(flight.readings)
    result: dict[str, Any] = {
        "readings": len(flight.readings),
        "used": found.used,
        "rms_before": found.rms_before,
        "rms_after": found.rms_after,
        "improvement": found.rms_before / max(found.rms_after, 1e-9),
        "own_field_peak_to_peak": float(np.nanmax(own) - np.nanmin(own)),
        "moved_deg": [float(np.degrees(one)) for one in found.swing],
        "condition": found.condition if np.isfinite(found.condition) else None,
        "determined": found.determined,
        "lag": compensation.lag,
        "offset": compensation.offset,
        "currents": list(compensation.currents),
    }
    if flight.places is not None:
        means = by_heading(flight.course, own)
        result["own_field_by_heading"] = {
            name: None if np.isnan(mean) else float(mean - np.nanmean(means))
            for name, mean in zip(_SECTORS, means, strict=True)
        }
    return result


def in_words(numbers: Mapping[str, Any], found: Calibration) -> list[str]:
    """Return what was found in lines, by its numbers."""
    moved = ", ".join(map(number, numbers["moved_deg"]))
    lines = [
        f"{found.used} of {numbers['readings']} readings count; in the band"
        f" {found.rms_before:.2f} nT before, {found.rms_after:.2f} nT after (RMS), improvement"
        f" {numbers['improvement']:.0f}",
        f"the vehicle adds {numbers['own_field_peak_to_peak']:.0f} nT, peak to peak",
        f"the field's direction moved by {moved}° (RMS on three axes), which tells"
        f" {found.determined:.1f} of {found.compensation.coefficients.size} combinations of"
        " coefficients; the others stay near zero",
    ]
    if found.compensation.lag:
        lines.append(f"the vector magnetometer is {found.compensation.lag:.3f} s late")
    return lines


@style.journal
def calibration_figure(found: Calibration) -> "Figure":
    """Draw the readings in the band before and after."""
    figure = style.new_figure(3.2)
    panel = figure.subplots()
    minutes = (found.time - found.time[0]) / 60.0
    panel.plot(minutes, found.before, lw=0.6, label=f"measured, RMS {found.rms_before:.2f} nT")
    panel.plot(minutes, found.after, lw=0.6, label=f"compensated, RMS {found.rms_after:.2f} nT")
    panel.set_xlabel("time (min)")
    panel.set_ylabel("total field in the band (nT)")
    style.legend_below(figure)
    return figure


def write_calibration_report(flight: MagneticFlight, found: Calibration, folder: Path) -> Path:
    """Write `report.html` with a PNG figure beside it; return the path of the page."""
    numbers, compensation = summary(flight, found), found.compensation
    tables = list[Table]()
    if means := numbers.get("own_field_by_heading"):
        title = f"The vehicle's field by heading, mean in {len(_SECTORS)} sectors (nT)"
        tables.append(Table(title, tuple(means), [[number(one) for one in means.values()]]))
    coefficients = zip(
        names(compensation.currents), compensation.coefficients, compensation.sigma, strict=True
    )
    rows = [[name, number(float(a)), number(float(b))] for name, a, b in coefficients]
    title, header = "Coefficients (nT; eddy nT s; current nT/A)", ("term", "value", "1σ")
    tables.append(Table(title, header, rows, folded=True))
    caption = "Total field less the main field, in the band of the manoeuvres."
    picture = Illustration("calibration", calibration_figure(found), caption)
    return write_report(
        folder,
        "Magnetometer calibration",
        [Section("Calibration", in_words(numbers, found), [picture], tables)],
        subtitle=Path(flight.readings.where).name,
    )
