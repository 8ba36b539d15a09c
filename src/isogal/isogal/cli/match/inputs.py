"""The track and the map of ``isogal match``, in one unit."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from isogal.cli.errors import note
from isogal.cli.map_choice import MapChoice
from isogal.cli.match.options import Assumptions, TrackChoice
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.maps.field_map import FieldMap
    from isogal.maps.tiled_map import ScalarMap
    from isogal.tracks.csv_file import CsvTrack
    from isogal.tracks.recording import Recording
    from isogal.tracks.track import Track

_UNUSED_SIGMA = 1.0
"""Of reference tracks: their noise is learnt."""
_DEFAULT_GRAVITY_SIGMA = 1.0e-5
"""m/s², as `gravimeter.sigma` of a scenario."""
_MARGIN = 25_000.0
"""m of map kept around a track, and five 1-sigmas of its position."""


@dataclass(frozen=True)
class Inputs:
    """A track and the map that it belongs to."""

    track: "Track"
    """NaN where the map has no value."""
    field_map: "ScalarMap"
    unit: str
    """Of the track's values, and of the sigmas on the command line."""
    factor: float
    """Units inside in one of it."""


def read_inputs(map_: MapChoice, chosen: TrackChoice, assumed: Assumptions) -> Inputs:
    """Read track and map, and learn the map's error from reference tracks; say on the standard
    error stream what was learnt and which readings are left out.

    Raises
    ------
    InputError
        A file cannot be read, or the track does not belong to the map.
    """
    from isogal.tracks.track import fit_to_map

    source = _source(chosen)
    corridor = source.corridor(_MARGIN + 5.0 * assumed.prior_sigma)
    # a map whose error is learnt gets a sigma at each of its nodes, and so has to be in memory
    references = assumed.reference or []
    learnt = map_.load(corridor.window) if references else None
    field_map = learnt or map_.load_along(corridor)
    unit, factor = _unit(chosen.track_unit, field_map)
    track = _track(source, field_map, factor, assumed.sensor_sigma, chosen.reduction)
    if learnt is not None:
        field_map = _with_learnt_error(learnt, references, factor)
    track, off_map = fit_to_map(track, field_map)
    if off_map.any():
        note(
            f"{track.where}: the map has no value at {int(off_map.sum())} of {len(track)}"
            " readings; left out"
        )
    return Inputs(track, field_map, unit, factor)


def _source(chosen: TrackChoice) -> "Recording | CsvTrack":
    from isogal.tracks.csv_file import read_csv_track
    from isogal.tracks.recording import is_recording, read_recording

    if not chosen.track.exists():
        raise InputError(f"{chosen.track}: no such file or folder")
    if is_recording(chosen.track):
        return read_recording(chosen.track, chosen.fix_topic)
    return read_csv_track(chosen.track)


def _unit(track_unit: str | None, field_map: "ScalarMap") -> tuple[str, float]:
    """Return the unit of the track's values, and the number of units inside in one of it."""
    from isogal.maps.quantities import unit_factor

    if track_unit is None:
        return field_map.file_unit, field_map.file_factor
    inside, factor = unit_factor(track_unit, "--track-unit")
    if inside != field_map.unit:
        raise InputError(
            f"--track-unit: '{track_unit}' does not fit a {field_map.quantity} map, which is"
            f" in {field_map.file_unit}"
        )
    return track_unit, factor


def _track(
    source: "Recording | CsvTrack",
    field_map: "ScalarMap",
    factor: float,
    sensor_sigma: float | None,
    reduction: str | None,
) -> "Track":
    from isogal.tracks.recording import Recording

    sigma = None if sensor_sigma is None else sensor_sigma * factor
    if isinstance(source, Recording):
        return source.track(field_map.quantity, sigma)
    if sigma is None and field_map.unit == "m/s²":
        sigma = _DEFAULT_GRAVITY_SIGMA
    return source.track(factor, sigma, reduction or "none")


def _with_learnt_error(
    field_map: "FieldMap", references: Sequence[Path], factor: float
) -> "FieldMap":
    """Return the map with the error that makes the residuals of tracks with true positions most
    likely."""
    import numpy as np

    from isogal.tracks.csv_file import read_csv_track
    from isogal.tracks.map_error import fit_map_error
    from isogal.tracks.track import fit_to_map

    tracks = [
        fit_to_map(read_csv_track(path).track(factor, _UNUSED_SIGMA), field_map)[0]
        for path in references
    ]
    fit = fit_map_error(tracks, field_map)
    learnt = fit.apply(field_map)
    sigma = [np.ravel(learnt.sigma_at(track.latitude, track.longitude)) for track in tracks]
    note(
        f"learnt from {sum(len(track) for track in tracks)} readings: map error"
        f" {np.nanmedian(np.concatenate(sigma)) / factor:.3g} (median there), correlated over"
        f" {fit.correlation_length:.0f} m; readings good to {fit.sensor_sigma / factor:.2g}"
    )
    return learnt
