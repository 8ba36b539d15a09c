"""Recorded tracks in CSV files with the columns time, latitude, longitude and value, and
optionally sigma and offset."""

import csv
import difflib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.corridor import Corridor, corridor_of
from isogal.tracks.track import Track

REQUIRED = ("time", "latitude", "longitude", "value")
OPTIONAL = ("sigma", "offset")
_RANGES = {"latitude": (-90.0, 90.0), "longitude": (-180.0, 360.0)}


@dataclass(frozen=True, slots=True, eq=False)
class CsvTrack:
    """Columns of a file in its own units, (N,) each; None = no such column."""

    where: str
    time: Array
    latitude: Array
    """deg."""
    longitude: Array
    """deg."""
    value: Array
    sigma: Array | None
    offset: Array | None

    def corridor(self, margin: float) -> Corridor:
        """Return the part of the Earth within a margin (m) of the track."""
        return corridor_of(np.radians(self.latitude), np.radians(self.longitude), margin)

    def track(self, factor: float, sensor_sigma: float | None, reduction: str = "none") -> Track:
        """Return the track, with values in the map's unit inside.

        Parameters
        ----------
        factor : float
            Number of units inside (`FieldMap.unit`) in one unit of the columns value, sigma and
            offset.
        sensor_sigma : float, optional
            1-sigma of the readings where the file has no column ``sigma``, unit inside.
        reduction : str
            See `Track.reduction`.

        Raises
        ------
        InputError
            Neither the file nor ``sensor_sigma`` says how noisy the readings are, or `Track`
            refuses them.
        """
        if self.sigma is not None:
            sigma = self.sigma * factor
        elif sensor_sigma is not None:
            sigma = np.full(self.time.size, sensor_sigma)
        else:
            raise InputError(f"{self.where}: has no column sigma; give --sensor-sigma")
        return Track(
            time=self.time,
            latitude=np.radians(self.latitude),
            longitude=np.radians(self.longitude),
            value=self.value * factor,
            sigma=sigma,
            offset=np.zeros(self.time.size) if self.offset is None else self.offset * factor,
            where=self.where,
            reduction=reduction,
            factor=factor,
        )


def read_csv_track(path: str | Path) -> CsvTrack:
    """Read a file with a header line.

    Cells are separated by commas, semicolons or tabs. Lines that start with ``#`` are comments.
    Other columns are ignored.

    Raises
    ------
    InputError
        The file cannot be read or lacks a column; or a cell is not a finite number, a place is out
        of range, or times do not increase, with the number of the line.
    """
    where = str(path)
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{where}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{where}: is not a text file (UTF-8)") from None
    lines = [
        (i, line)
        for i, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.startswith("#")
    ]
    if not lines:
        raise InputError(f"{where}: is empty; it needs a header with {', '.join(REQUIRED)}")
    delimiter = max(",;\t", key=lines[0][1].count)
    try:
        rows = list(
            csv.reader((line for _, line in lines), delimiter=delimiter, skipinitialspace=True)
        )
    except csv.Error as error:
        raise InputError(f"{where}: is not a CSV file: {error}") from None
    if len(rows) != len(lines):
        raise InputError(f"{where}: a quoted cell runs over several lines")
    header = [name.strip().casefold() for name in rows[0]]
    index = _locate(header, where)
    numbers = {name: np.empty(len(rows) - 1) for name in index}
    for k, (row, (line, _)) in enumerate(zip(rows[1:], lines[1:], strict=True)):
        if len(row) != len(header):
            raise InputError(
                f"{where}: line {line} has {len(row)} cells, the header {len(header)}"
            )
        for name, i in index.items():
            numbers[name][k] = _number(row[i], name, line, where)
    late = np.flatnonzero(np.diff(numbers["time"]) <= 0.0)
    if late.size:
        i = int(late[0])
        raise InputError(
            f"{where}: times must increase; line {lines[i + 2][0]} ({numbers['time'][i + 1]:.10g}"
            f" s) is not later than line {lines[i + 1][0]} ({numbers['time'][i]:.10g} s)"
        )
    return CsvTrack(
        where,
        **{name: numbers[name] for name in REQUIRED},
        sigma=numbers.get("sigma"),
        offset=numbers.get("offset"),
    )


def _locate(header: list[str], where: str) -> dict[str, int]:
    index: dict[str, int] = {}
    for name in (*REQUIRED, *OPTIONAL):
        if header.count(name) > 1:
            raise InputError(f"{where}: has {header.count(name)} columns '{name}'")
        if name in header:
            index[name] = header.index(name)
        elif name in REQUIRED:
            others = [h for h in header if h and h not in REQUIRED]
            close = [h for h in others if name.startswith(h)] + difflib.get_close_matches(
                name, others, n=1, cutoff=0.6
            )
            hint = f" (is it '{close[0]}'?)" if close else ""
            raise InputError(
                f"{where}: has no column '{name}'{hint}; it has"
                f" {', '.join(h or '(no name)' for h in header)}"
            )
    return index


def _number(cell: str, name: str, line: int, where: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        shown = f"'{cell.strip()[:40]}'" if cell.strip() else "empty"
        raise InputError(f"{where}: {name} in line {line} is {shown}, not a number") from None
    if not np.isfinite(value):
        raise InputError(
            f"{where}: {name} in line {line} is {cell.strip()}, not a finite number (leave the"
            " line out)"
        )
    low, high = _RANGES.get(name, (-np.inf, np.inf))
    if not low <= value <= high:
        raise InputError(
            f"{where}: {name} in line {line} is {cell.strip()} deg, must be {low:g} to {high:g}"
        )
    if name == "sigma" and value <= 0.0:
        raise InputError(f"{where}: sigma in line {line} is {cell.strip()}, must be > 0")
    return value
