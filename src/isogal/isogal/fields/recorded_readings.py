"""Recorded readings along a recorded track, in place of simulated ones.

Each keeps its own time: none is interpolated. Scans are counted by the instrument's interval, so
that batches have the length that the scenario says; each has the newest reading of its interval,
or none. Where readings fall between the navigator's whole intervals they are that much late."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import changed_at
from isogal.maps.gridding.rows import TIME, Column, one_line, read_rows
from isogal.maps.quantities import QUANTITIES, check_plausible, unit_factor
from isogal.scenario import Readings

_ALIASES = {
    "disturbance": ("gravity_anomaly", *QUANTITIES["gravity_anomaly"].names.split(), "free_air"),
    "magnetic_anomaly": ("mag_res", "residual_field"),
    "height": ("depth",),
}
"""Names of columns of values as maps have them, beside those of `isogal.maps.quantities`."""
_UNITS = {"m/s²": "mGal", "nT": "nT", "m": "m"}
"""Of a column whose file does not say it, by the unit inside."""
_DOWN = "depth"
"""Column whose values are heights counted downwards."""


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """Readings of S scans."""

    time: Array
    """(S,) s since the track's begin; of a scan without a reading when it would have been."""
    value: Array
    """(S,) unit inside; NaN = none."""


def recorded_scans(
    readings: Readings, line: str | None, quantity: str, clock: tuple[float, float, int]
) -> Recorded:
    """Return the readings of a field's scans.

    Parameters
    ----------
    readings : scenario.Readings
    line : str, optional
        Survey line of the track.
    quantity : str
        What the field's map is of.
    clock : (float, float, int)
        Begin of the track on the file's clock (s), time between scans (s) and their number S.

    Raises
    ------
    InputError
        The file cannot be read, lacks the column, its unit or numbers cannot be those of the
        field, or none of its readings is within the track's time.
    """
    begin, interval, count = clock
    time, value = _read(readings, line, quantity, changed_at(readings.source or ""))
    since = time - begin
    used = np.isfinite(value) & (since > 0.0) & (since <= interval * count + 1e-6)
    if not used.any():
        raise InputError(
            f"readings.source: {readings.source}: no reading is within the track's time, {begin:g}"
            f" to {begin + interval * count:g} s; they are of {time.min():g} to {time.max():g} s"
        )
    since, value = since[used], value[used]
    end = _end_of_scans(np.mod(np.round(since, 6), interval), interval)
    scan = np.ceil((since - end) / interval - 1e-6).astype(np.int64)
    kept = (scan >= 1) & (scan <= count)
    scan, since, value = scan[kept], since[kept], value[kept]
    late = float(np.median(scan * interval - since)) if len(scan) else 0.0
    usual = np.arange(1, count + 1, dtype=np.float64) * interval - late
    result = Recorded(usual, np.full(count, np.nan))
    result.time[scan - 1], result.value[scan - 1] = since, value  # in order: the newest stays
    return result


def _end_of_scans(phase: Array, interval: float) -> float:
    """Return the time (s, above -interval and at most 0) at which scan 0 ends, so that readings
    which come at phases (N,), s, of an interval are apart from the ends: that of the last reading
    before the longest time without any."""
    sorted_ = np.unique(phase)
    gaps = np.diff(sorted_, append=sorted_[0] + interval)
    last = float(sorted_[int(np.argmax(gaps))])
    return last - interval if last > 0.0 else 0.0


@lru_cache(maxsize=8)
def _read(
    readings: Readings, line: str | None, quantity: str, changed: int
) -> tuple[Array, Array]:
    """Return times (s, on the file's clock, increasing) and readings (unit inside; NaN = none);
    `changed`: see `changed_at`."""
    assert readings.source is not None  # the caller has checked
    rows = read_rows(readings.source, "time and a column of readings")
    if rows.line is not None and line in rows.line:
        rows = one_line(rows, line)
    known = quantity, *QUANTITIES[quantity].names.split(), *_ALIASES.get(quantity, ()), "value"
    names = known if readings.column is None else (readings.column.casefold(),)
    column = Column(names, gaps=True)
    index = rows.index(column)
    if index is None:
        raise InputError(
            f"readings.column: {rows.where} has no column {' or '.join(names)}; it has"
            f" {', '.join(rows.names)}"
        )
    found = rows.read({"time": TIME, "value": column}, ("time", "value"))
    name = rows.names[index]
    of = quantity if readings.reduced else {"magnetic_anomaly": "magnetic_field"}.get(quantity)
    inside = QUANTITIES[quantity].unit
    unit = readings.unit or rows.units.get(name) or _UNITS.get(inside, inside)
    _, factor = unit_factor(unit, f"readings.unit: {rows.where}, column {name}", inside)
    value = found["value"] * factor
    if not np.isfinite(value).any():
        raise InputError(f"readings.source: {rows.where}: column {name} has no value at all")
    if readings.reduced and name == _DOWN:
        value = -value
    if of is not None:
        found_range = float(np.nanmin(value)) / factor, float(np.nanmax(value)) / factor
        check_plausible(found_range, of, factor, f"readings.unit: {rows.where}:{name}")
    order = np.argsort(found["time"], kind="stable")
    return found["time"][order], value[order]
