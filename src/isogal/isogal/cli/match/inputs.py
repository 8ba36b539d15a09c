"""The track and the map of ``isogal match``, in one unit."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING

from isogal.cli.errors import note
from isogal.cli.map_choice import MapChoice
from isogal.cli.match.options import Assumptions
from isogal.cli.match.track_choice import TrackChoice
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.maps.axes import Window
    from isogal.maps.channels import RouteMap
    from isogal.maps.field_map import FieldMap
    from isogal.maps.tiled_map import ScalarMap
    from isogal.tracks.fields import ChannelReadings
    from isogal.tracks.map_error import MapError
    from isogal.tracks.recording import Recording
    from isogal.tracks.track import Track

_UNUSED_SIGMA = 1.0
"""Of reference tracks: their noise is learnt."""
_DEFAULT_GRAVITY_SIGMA = 1.0e-5
"""m/s², as `gravimeter.sigma` of a scenario."""
_LEAST_SHARE = 0.05
"""Of the map's learnt error: no learnt noise of the readings is taken as smaller."""
_MARGIN = 25_000.0
"""m of map kept around a track, and five 1-sigmas of its position."""
_REFERENCE_MARGIN = 5_000.0
"""m of map kept around reference tracks."""


@dataclass(frozen=True)
class Inputs:
    """A track and the map that it belongs to."""

    track: "Track"
    field_map: "RouteMap"
    unit: str
    """Of the track's values, and of the sigmas on the command line."""
    factor: float
    """Units inside in one of it."""
    line: str | None = None
    """Of a file that holds several."""
    channels: "ChannelReadings | None" = None
    """Readings of several numbers each."""

    @property
    def scalar_map(self) -> "ScalarMap":
        """The map, or the first of several: what is said of one is said of all."""
        from isogal.maps.channels import channels_of

        return channels_of(self.field_map)[0]


def read_inputs(map_: MapChoice, chosen: TrackChoice, assumed: Assumptions) -> list[Inputs]:
    """Read tracks and map, and learn the map's error from reference tracks; say on the standard
    error stream what was learnt and which readings are off the map.

    Raises
    ------
    InputError
        A file cannot be read, or a track does not belong to the map.
    """
    from isogal.maps.corridor import joined
    from isogal.tracks.averaging import averaged
    from isogal.tracks.csv_file import read_csv_track
    from isogal.tracks.track import fit_to_map

    sources = _sources(chosen, map_.crs)
    references = [read_csv_track(path, map_.crs) for path in assumed.reference or ()]
    if any(getattr(one, "projected", False) for one in [*sources, *references]):
        map_ = without_crs(map_)
    margin = _MARGIN + 5.0 * assumed.prior_sigma
    corridors = [source.corridor(margin) for source in sources]
    # a map whose error is learnt gets a sigma at each of its nodes, and so has to be in memory
    learnt: FieldMap | None = None
    if references:
        around = [one.corridor(_REFERENCE_MARGIN) for one in references]
        window = reduce(joined, (one.window for one in [*corridors, *around]))
        learnt = _at_height(map_, chosen, window) or map_.load(window)
    fit: MapError | None = None
    found = []
    for source, corridor in zip(sources, corridors, strict=True):
        field_map: ScalarMap | None = learnt or _at_height(map_, chosen, corridor.window)
        field_map = field_map or map_.load_along(corridor)
        unit, factor = unit_of(chosen.track_unit, field_map)
        sigma = assumed.reading_sigma(field_map, factor)
        if learnt is not None:
            fit = fit or _learnt_error(learnt, references, factor)
            field_map = fit.apply(learnt)
            sigma = sigma or max(fit.sensor_sigma, _LEAST_SHARE * fit.typical_sigma)
        track = _track(source, field_map, factor, sigma, chosen.reduction)
        if chosen.spacing is not None:
            track = averaged(track, chosen.spacing)
        track, off_map = fit_to_map(track, field_map)
        if off_map.any():
            note(
                f"{track.where}: the map has no value at {int(off_map.sum())} of {len(track)}"
                " readings as recorded"
            )
        found.append(Inputs(track, field_map, unit, factor, getattr(source, "line", None)))
    return found


def _at_height(map_: MapChoice, chosen: TrackChoice, window: "Window") -> "FieldMap | None":
    """Return a window of the map at the height of the readings; None where nobody says it.

    Raises
    ------
    InputError
        Nobody says what level the map's values hold on, or it cannot be continued.
    """
    from isogal.maps.continuation.blocks import CONTINUED, continued, rim_of

    if chosen.height is None:
        return None
    level = chosen.map_height
    if level is None:
        field_map = map_.load(window)
        level = field_map.height
        if level is None:
            raise InputError(
                f"--height {chosen.height:g}: {field_map.provenance} does not say what level its"
                " values hold on; give --map-height"
            )
    rim = rim_of(chosen.height - level)
    wide = map_.load(window.grown(rim)._replace(most_cells=2 * window.most_cells))
    if wide.quantity not in CONTINUED:
        raise InputError(
            f"--height {chosen.height:g}: a map of {wide.quantity} cannot be continued; of"
            f" {', '.join(CONTINUED)} it can"
        )
    return continued(wide, chosen.height, level).window(*window[:4])


def without_crs(map_: MapChoice) -> MapChoice:
    """Return a map without `--crs` that is meant for the track: only a GeoTIFF takes one."""
    is_geotiff = str(map_.source).casefold().endswith((".tif", ".tiff"))
    return map_ if is_geotiff else replace(map_, crs=None)


def _sources(chosen: TrackChoice, crs: str | None) -> "Sequence[Recording | Track]":
    from isogal.tracks.csv_file import read_csv_tracks
    from isogal.tracks.recording import is_recording, read_recording

    if not chosen.track.exists():
        raise InputError(f"{chosen.track}: no such file or folder")
    if chosen.compensation is None and is_recording(chosen.track):
        for option, given in (("--base", chosen.base), ("--column", chosen.column)):
            if given is not None:
                raise InputError(
                    f"{option}: goes with a text file, not with a bag ({chosen.track})"
                )
        return [read_recording(chosen.track, chosen.fix_topic)]
    if chosen.compensation is not None:
        tracks = [_compensated(chosen.track, chosen.compensation)]
    else:
        tracks = read_csv_tracks(chosen.track, crs, chosen.column or "value")
    if chosen.base is None:
        return tracks
    from isogal.tracks.magnetic_flight import read_base_station

    station = read_base_station(chosen.base)
    return [one.less_variation(station) for one in tracks]


def _compensated(path: Path, coefficients: Path) -> "Track":
    """Return a flight's anomaly, nT, without the vehicle's own field."""
    from isogal.magnetics.compensation import read_compensation
    from isogal.scenario import Magnetometer
    from isogal.tracks.magnetic_flight import read_magnetic_flight

    compensation, flight = read_compensation(coefficients), read_magnetic_flight(path)
    total = compensation.clean(flight.readings)
    return replace(flight.placed, value=total - flight.main_field(Magnetometer().epoch))


def unit_of(track_unit: str | None, field_map: "ScalarMap") -> tuple[str, float]:
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
    source: "Recording | Track",
    field_map: "ScalarMap",
    factor: float,
    sigma: float | None,
    reduction: str | None,
) -> "Track":
    from isogal.tracks.recording import Recording

    if isinstance(source, Recording):
        return source.track(field_map.quantity, sigma)
    if sigma is None and field_map.unit == "m/s²":
        sigma = _DEFAULT_GRAVITY_SIGMA
    if reduction == "velocity" and not source.timed:
        raise InputError(f"{source.where}: --reduction velocity needs a column time")
    return source.in_unit(factor, sigma, reduction or "none")


def _learnt_error(
    field_map: "FieldMap", references: "Sequence[Track]", factor: float
) -> "MapError":
    """Return the error that makes the residuals of tracks with true positions most likely, and
    say it."""
    from isogal.tracks.map_error import fit_map_error
    from isogal.tracks.track import fit_to_map

    tracks = [
        fit_to_map(source.in_unit(factor, _UNUSED_SIGMA), field_map)[0] for source in references
    ]
    fit = fit_map_error(tracks, field_map)
    note(
        f"learnt from {sum(len(track) for track in tracks)} readings: map error"
        f" {fit.typical_sigma / factor:.3g} (RMS there), correlated over"
        f" {fit.correlation_length:.0f} m; map too low by {fit.offset / factor:.2g} (1-sigma"
        f" {fit.offset_sigma / factor:.2g}); readings good to {fit.sensor_sigma / factor:.2g}"
    )
    if fit.at_bound:
        note(
            f"the correlation length is at its least, {fit.correlation_length:.0f} m: the errors"
            " look independent from one reading or node of the map to the next; more or denser"
            " reference tracks would tell it better"
        )
    return fit
