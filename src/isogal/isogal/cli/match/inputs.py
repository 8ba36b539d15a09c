"""The fields of ``isogal match``: of each the track and the map, in one unit, and the matcher's
settings. A field is of scalar readings, or of the components of a gradiometer, in E."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from isogal.cli.errors import note
from isogal.cli.map_choice import MapChoice, MapOption
from isogal.cli.match.options import Assumptions, MatcherChoice, TrackChoice, check_together
from isogal.cli.option_groups import run_with_groups
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.maps.axes import Window
    from isogal.maps.field_map import FieldMap
    from isogal.maps.tiled_map import ScalarMap
    from isogal.scenario import Gradiometer, Matcher, Scenario
    from isogal.tracks.fields import TrackField
    from isogal.tracks.track import Track

_UNUSED_SIGMA = 1.0
"""Of reference tracks whose noise is learnt."""
_DEFAULT_SIGMA = {"m/s²": 1.0e-5, "1/s²": 1.0e-9}
"""Of readings, by the unit inside: `gravimeter.sigma` and `gradiometer.sigma_eotvos` of a
scenario."""
_MARGIN = 25_000.0
"""m of map kept around a track, and five 1-sigmas of its position; more than `_GRADIENT_REACH`."""
_REFERENCE_MARGIN = 5_000.0
"""m of map kept around reference tracks."""
_GRADIENT_REACH = 20_000.0
"""m, within which of a map's edge its gradients are not known."""
_REQUIRED = ("map", "column")
KEYS = (
    *_REQUIRED,
    *("variable", "quantity", "unit", "crs", "format"),
    *("track-unit", "reduction", "height", "map-height"),
    *("sensor-sigma", "map-sigma", "map-correlation-length", "bias-sigma"),
)
"""Of `--also`: options of these names."""


@dataclass(frozen=True)
class FieldChoice:
    """One field: its map, its readings, and what is assumed of their errors."""

    name: str
    map_: MapChoice
    track: TrackChoice
    assumed: Assumptions

    @property
    def margin(self) -> float:
        """How much of the map is kept around a track, m."""
        return _MARGIN + 5.0 * self.assumed.prior_sigma

    def read(self, matching: MatcherChoice) -> "list[TrackField]":
        """Return the field for each line of the file; say on the standard error stream what was
        learnt of the map's error, what is assumed that is not specified, and which readings are
        off the map.

        Raises
        ------
        InputError
            A file cannot be read, a track does not belong to the map, or options do not go
            together.
        """
        name = _scenario(matching.changes()).matcher.name
        each = _scalars(self) if self.track.gradients is None else _gradients(self, name)
        return [replace(one, settings=self.settings(matching, one)) for one in each]

    def settings(self, matching: MatcherChoice, field: "TrackField") -> "Matcher":
        """Return the scenario's section `matcher`; say what is assumed that is not specified.

        Sigmas of the options are in the track's unit, those of ``--set`` in the unit inside.

        Raises
        ------
        InputError
            A key or a value is not allowed.
        """
        one, track = field.scalar_map, field.track
        changes = matching.changes() + self.assumed.changes(one, track.factor)
        settings = _scenario(changes).matcher
        given, more = settings.model_fields_set, dict[str, float | None]()
        if "map_correlation_length" not in given and one.correlation_length is not None:
            more["map_correlation_length"] = one.correlation_length
        if "map_sigma" not in given and not one.states_error:
            note(
                "the map does not say how wrong it is, which is estimated along the track; give"
                " --map-sigma where it is known"
            )
        if matching.whole:
            more |= {"batch_length": len(track), "stride": None}
        doubt = track.normal_gravity_in_doubt(one.quantity) * self.assumed.prior_sigma
        if doubt > 0.0 and self.track.reduction is None:
            note(
                f"{track.where}: offset holds normal gravity; as it does not say at which"
                f" latitude, an unknown constant of {doubt / track.factor:.2g} {field.unit} is"
                " allowed for. Say --reduction latitude if it was the track's own, else"
                " --reduction none"
            )
            more["bias_sigma"] = math.hypot(settings.bias_sigma, doubt)
        return settings.model_copy(update=more)


def _scalars(choice: FieldChoice) -> "Iterator[TrackField]":
    """Yield the field of each line; learn the map's error from reference tracks."""
    from isogal.maps.corridor import corridor_of, joined
    from isogal.tracks.averaging import averaged
    from isogal.tracks.csv_file import read_csv_tracks
    from isogal.tracks.fields import TrackField

    map_, chosen, assumed = choice.map_, choice.track, choice.assumed
    lines = _lines(chosen, map_.crs)
    files = (read_csv_tracks(path, map_.crs) for path in assumed.reference or ())
    references = [one for file in files for one in file]
    map_ = _of_map(map_, [*(one[0] for one in lines), *references])
    corridors = [corridor_of(o.latitude, o.longitude, choice.margin) for o, *_ in lines]
    # a map whose error is learnt gets a sigma at each of its nodes, and so has to be in memory
    learnt: tuple[FieldMap, float] | None = None
    if references:
        around = [corridor_of(o.latitude, o.longitude, _REFERENCE_MARGIN) for o in references]
        window = reduce(joined, (one.window for one in [*corridors, *around]))
        whole = _at_height(map_, chosen, window) or map_.load(window)
        learnt = _learnt_error(whole, references, choice)
    for line, corridor in zip(lines, corridors, strict=True):
        field_map: ScalarMap | None
        field_map = learnt[0] if learnt else _at_height(map_, chosen, corridor.window)
        field_map = field_map or map_.load_part(corridor)
        unit, factor = _unit_of(chosen.track_unit, field_map, line[0])
        sigma = assumed.reading_sigma(field_map, factor) if learnt is None else learnt[1]
        track = _track(line, field_map, factor, sigma, chosen.reduction)
        if chosen.spacing is not None:
            track = averaged(track, chosen.spacing)
        yield TrackField(choice.name, _on_map(track, field_map), field_map, unit=unit)


def _gradients(choice: FieldChoice, matcher: str) -> "Iterator[TrackField]":
    """Yield the field of a gradiometer for each line; compute the maps of its components."""
    import numpy as np

    from isogal.maps.corridor import corridor_of
    from isogal.maps.potential import derivatives
    from isogal.matching.expansion import Channels, with_allowed_tilt
    from isogal.tracks.csv_file import read_csv_tracks
    from isogal.tracks.fields import TrackField

    map_, chosen = choice.map_, choice.track
    names = (one.strip().casefold() for one in (chosen.gradients or "").split(","))
    components = tuple(name for name in names if name)
    columns = ((f"t_{name}", f"t{name}", name) for name in components)
    each = (read_csv_tracks(chosen.track, map_.crs, column) for column in columns)
    for line in zip(*each, strict=True):
        first = line[0]
        corridor = corridor_of(first.latitude, first.longitude, choice.margin)
        disturbance = _of_map(map_, line).load(corridor.window, "disturbance")
        rise = 0.0 if chosen.height is None else chosen.height - _level(chosen, disturbance)
        if rise < 0.0:
            raise InputError(
                f"--height {chosen.height:g}: is {-rise:g} m below the map's level: a map cannot"
                " be continued down towards the masses"
            )
        maps = derivatives(disturbance, components, height=rise, edge=_GRADIENT_REACH)
        scalar = maps.channels[0]
        unit, factor = _unit_of(chosen.track_unit or _one_unit(line) or "E", scalar)
        sigma = choice.assumed.reading_sigma(scalar, factor) or _DEFAULT_SIGMA[scalar.unit]
        values = np.stack([one.value for one in line], axis=1) * factor
        nothing = np.zeros(len(first))
        track = replace(first, sigma=nothing + math.nan, offset=nothing).in_unit(factor, sigma)
        assumed = with_allowed_tilt(_instrument(components, chosen), matcher)
        channels = Channels(sigma**2 * np.eye(len(components)), assumed)
        track = _on_map(track, scalar)
        yield TrackField(choice.name, track, maps, channels=channels, values=values, unit=unit)


def _on_map(track: "Track", field_map: "ScalarMap") -> "Track":
    """Return what can be matched of a track; say how many readings are off the map."""
    from isogal.tracks.track import fit_to_map

    track, off_map = fit_to_map(track, field_map)
    if off_map.any():
        note(
            f"{track.where}: the map has no value at {int(off_map.sum())} of {len(track)}"
            " readings as recorded"
        )
    return track


def _at_height(map_: MapChoice, chosen: TrackChoice, window: "Window") -> "FieldMap | None":
    """Return a window of the map at the height of the readings; None where none is given.

    Raises
    ------
    InputError
        Nothing says what level the map's values hold on, or it cannot be continued.
    """
    from isogal.maps.continuation.blocks import continued, rim_of

    if chosen.height is None:
        return None
    level = _level(chosen, map_.load(window))
    rim = rim_of(chosen.height - level)
    wide = map_.load(window.grown(rim)._replace(most_cells=2 * window.most_cells))
    return continued(wide, chosen.height, level, window=window).window(*window[:4])


def _level(chosen: TrackChoice, field_map: "FieldMap") -> float:
    """Return the level (m) that a map's values hold on; raises InputError where nothing says."""
    level = field_map.height if chosen.map_height is None else chosen.map_height
    if level is None:
        raise InputError(
            f"--height {chosen.height:g}: {field_map.provenance} does not say what level its"
            " values hold on; give --map-height"
        )
    return level


def _of_map(map_: MapChoice, tracks: "Sequence[Track]") -> MapChoice:
    """Return a map without a `--crs` that is meant for tracks: only a GeoTIFF takes one."""
    of_track = any(one.projected for one in tracks)
    is_geotiff = str(map_.source).casefold().endswith((".tif", ".tiff"))
    return replace(map_, crs=None) if of_track and not is_geotiff else map_


def _lines(chosen: TrackChoice, crs: str | None) -> "Sequence[Sequence[Track]]":
    """Return the track for each line of a file; of a bag one for each quantity."""
    from isogal.magnetics.flight import read_base_station
    from isogal.tracks.csv_file import read_csv_tracks
    from isogal.tracks.recording import FIX_TOPIC, is_recording, read_recording

    of_bag = is_recording(chosen.track)
    for option, given, goes_with_bag in (
        ("--fix-topic", chosen.fix_topic, True),
        ("--base", chosen.base, False),
        ("--column", chosen.column, False),
    ):
        if given is not None and of_bag != goes_with_bag:
            kind = "bag" if goes_with_bag else "text file"
            raise InputError(f"{option}: goes with a {kind}, which {chosen.track} is not")
    if not chosen.track.exists():
        raise InputError(f"{chosen.track}: no such file or folder")
    if of_bag:
        return [read_recording(chosen.track, chosen.fix_topic or FIX_TOPIC)]
    if chosen.compensation is not None:
        tracks = [_compensated(chosen.track, chosen.compensation)]
    else:
        tracks = read_csv_tracks(chosen.track, crs, chosen.column or "value")
        if unused := tracks[0].unused:
            note(
                f"{chosen.track}: {', '.join(unused)} not used: the track keeps the shape of its"
                " positions; isogal bag and isogal replay navigate by them"
            )
    if chosen.base is not None:
        station = read_base_station(chosen.base)
        tracks = [one.less_variation(station) for one in tracks]
    return [[one] for one in tracks]


def _compensated(path: Path, coefficients: Path) -> "Track":
    """Return a flight's anomaly, nT, without the vehicle's own field."""
    from isogal.magnetics.compensation import read_compensation
    from isogal.magnetics.flight import read_magnetic_flight
    from isogal.scenario import Magnetometer
    from isogal.tracks.track import Track

    compensation, flight = read_compensation(coefficients), read_magnetic_flight(path)
    readings, (latitude, longitude) = flight.readings, flight.placed
    value = compensation.clean(readings) - flight.main_field(Magnetometer().epoch)
    none = 0.0 * readings.time
    where = readings.where
    return Track(readings.time, latitude, longitude, value, none + math.nan, none, where)


def _unit_of(
    track_unit: str | None, field_map: "ScalarMap", track: "Track | None" = None
) -> tuple[str, float]:
    """Return the unit of a track's values, and the number of units inside in one of it: as the
    option says, else the track's file, else the map's."""
    from isogal.cli.sigmas import factor_of

    if track_unit is None and track is not None and track.unit is not None:
        return track.unit, factor_of(track.unit, f"{track.where}: value", field_map)
    if track_unit is None:
        return field_map.file_unit, field_map.file_factor
    return track_unit, factor_of(track_unit, "--track-unit", field_map)


def _one_unit(line: "Sequence[Track]") -> str | None:
    """Return the unit that the file says of the components; None where it says none. Raises
    InputError where they have several."""
    units = {one.unit for one in line}
    if len(units) > 1:
        named = ", ".join(sorted(unit or "none said" for unit in units))
        raise InputError(f"{line[0].where}: components have several units: {named}")
    return units.pop()


def _track(
    line: "Sequence[Track]",
    field_map: "ScalarMap",
    factor: float,
    sigma: float | None,
    reduction: str | None,
) -> "Track":
    """Return the track that has the map's readings, in the unit inside."""
    fitting = [one for one in line if one.quantity in (None, field_map.quantity)]
    if not fitting:
        raise InputError(
            f"{line[0].where}: has readings of {' and '.join(str(o.quantity) for o in line)}, and"
            f" the map is of {field_map.quantity}"
        )
    track = fitting[0]
    if track.quantity is not None:
        if sigma is not None:
            track = replace(track, sigma=sigma + 0.0 * track.time)
        return replace(track.in_unit(1.0, None, track.reduction), factor=factor)
    if reduction == "velocity" and not track.timed:
        raise InputError(f"{track.where}: --reduction velocity needs a column time")
    sigma = _DEFAULT_SIGMA.get(field_map.unit) if sigma is None else sigma
    return track.in_unit(factor, sigma, reduction or "none")


def _learnt_error(
    field_map: "FieldMap", references: "Sequence[Track]", choice: FieldChoice
) -> "tuple[FieldMap, float]":
    """Return the map with the error that tracks with true positions show, and the 1-sigma of
    readings, which they show where no option says it; say both."""
    from isogal.tracks.map_error import reading_sigma, with_learnt_error
    from isogal.tracks.track import fit_to_map

    of_option = choice.track.track_unit
    each = [_unit_of(of_option, field_map, one)[1] for one in references]
    factor = each[0]
    sigma = choice.assumed.reading_sigma(field_map, factor)

    def with_sigma(sigma: float) -> "list[Track]":
        return [
            fit_to_map(one.in_unit(own, sigma), field_map)[0]
            for one, own in zip(references, each, strict=True)
        ]

    if sigma is None:
        sigma = reading_sigma(with_sigma(_UNUSED_SIGMA), field_map)
    tracks = with_sigma(sigma)
    learnt, error = with_learnt_error(tracks, field_map)
    note(
        f"learnt from {sum(len(track) for track in tracks)} readings: map error"
        f" {error / factor:.3g} (RMS there), correlated over {learnt.correlation_length:.0f} m;"
        f" readings good to {sigma / factor:.2g}"
    )
    return learnt, sigma


def _instrument(components: tuple[str, ...], chosen: TrackChoice) -> "Gradiometer":
    """Return what the options say of the gradiometer; raises InputError where it cannot be."""
    keys = {
        "components": list(components),
        "allowed_tilt": chosen.tilt_sigma,
        "bias_eotvos": chosen.offset_sigma,
        "bias_walk_eotvos": chosen.offset_walk,
        "map_errors": "one_potential" if chosen.one_potential else "independent",
    }
    return _scenario([f"gradiometer.{key}={x}" for key, x in keys.items()]).gradiometer


def _scenario(changes: list[str]) -> "Scenario":
    """Return the scenario of all defaults with some keys changed; raises InputError."""
    from isogal.scenario import load_scenario

    try:
        return load_scenario(None, changes)
    except InputError as error:
        raise InputError(str(error).removeprefix("scenario: ")) from None


def read_fields(
    map_: MapChoice, track: TrackChoice, assumed: Assumptions, matching: MatcherChoice
) -> "list[tuple[TrackField, ...]]":
    """Return for each line of the track's file the field of the options themselves and those of
    `--also`.

    Raises
    ------
    InputError
        `--also` is not understood, or says what does not go together; or as `FieldChoice.read`.
    """
    _scenario(matching.changes())  # refuses what is wrong before a file is read
    name = "gradients" if track.gradients is not None else (track.column or "value")
    first = FieldChoice(name, map_, replace(track, also=None), assumed)
    every = [first, *(_also(text, first) for text in track.also or ())]
    return list(zip(*(one.read(matching) for one in every), strict=True))


def _also(text: str, first: FieldChoice) -> FieldChoice:
    """Return the field of an `--also`, whose keys are read as the options of their names."""
    from isogal.tracks.recording import is_recording

    given = _keys(text)
    if is_recording(first.track.track):
        raise InputError(f"--also: goes with a text file, not with a bag ({first.track.track})")
    given |= {"track": str(first.track.track), "prior-sigma": str(first.assumed.prior_sigma)}
    if first.track.spacing is not None:
        given["spacing"] = str(first.track.spacing)
    found: list[FieldChoice] = []

    def also(map_: MapOption, track: TrackChoice, assumed: Assumptions) -> None:
        check_together(track, assumed)
        found.append(FieldChoice(given["column"], map_, track.resolved(), assumed))

    try:
        run_with_groups(also, [f"--{key}={value}" for key, value in given.items()])
    except (typer.TyperException, InputError) as error:
        said = str(error) if isinstance(error, InputError) else error.format_message()
        raise InputError(f"--also {text}: {said}") from None
    return found[0]


def _keys(text: str) -> dict[str, str]:
    """Return the keys and values of ``KEY=VALUE,...``; raises InputError."""
    given: dict[str, str] = {}
    for part in text.split(","):
        key, _, value = (word.strip() for word in part.partition("="))
        if key not in KEYS or not value or key in given:
            raise InputError(
                f"--also {text}: '{part}' must be KEY=VALUE, each of these at most once:"
                f" {', '.join(KEYS)}"
            )
        given[key] = value
    missing = [key for key in _REQUIRED if key not in given]
    if missing:
        raise InputError(f"--also {text}: {' and '.join(missing)} must be given")
    return given
