"""``isogal match``: a recorded track of any scalar field against a map."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.maps.field_map import FieldMap
    from isogal.scenario import Matcher
    from isogal.tracks.matching import Match
    from isogal.tracks.track import Track

_MAP, _PRIOR, _OUT = "Map", "What is assumed", "Results"
_UNUSED_SIGMA = 1.0  # of reference tracks: their noise is learnt
_DEFAULT_GRAVITY_SIGMA = 1.0e-5  # m/s², as `gravimeter.sigma` of a scenario


def match(
    map_: Annotated[
        Path,
        typer.Option(
            "--map", metavar="FILE", help="NetCDF, GeoTIFF, ICGEM or XYZ file, or GGMplus folder."
        ),
    ],
    track: Annotated[
        Path,
        typer.Option(
            "--track",
            metavar="FILE",
            help=(
                "CSV file with the columns time (s), latitude, longitude (deg, where the navigator"
                " said it was), value,"
                " and if you like sigma and offset (added to the map's value); or a bag (MCAP)."
            ),
        ),
    ],
    out: Annotated[
        list[Path] | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="Results, by suffix: .json, .csv or .geojson; repeatable.",
            rich_help_panel=_OUT,
        ),
    ] = None,
    variable: Annotated[
        str | None,
        typer.Option(
            "--variable", metavar="NAME", help="Variable of the map.", rich_help_panel=_MAP
        ),
    ] = None,
    quantity: Annotated[
        str | None,
        typer.Option(
            "--quantity", help="What the map is of, where it does not say.", rich_help_panel=_MAP
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(
            "--unit", help="Unit of the map, where it does not say.", rich_help_panel=_MAP
        ),
    ] = None,
    track_unit: Annotated[
        str | None,
        typer.Option(
            "--track-unit",
            metavar="UNIT",
            help=(
                "Unit of value, sigma and offset and of the sigma options below; default: the map"
                " file's."
            ),
        ),
    ] = None,
    reduction: Annotated[
        str | None,
        typer.Option(
            "--reduction",
            metavar="none|latitude|velocity|main-field",
            help=(
                "What of the track itself went into value or offset: normal gravity at its"
                " latitude, or also the Eötvös"
                " acceleration of its velocity, or the Earth's main magnetic field at its"
                " position. A candidate elsewhere would"
                " have had another. Default: none, but an offset that holds normal gravity is"
                " allowed to be that of another"
                " latitude. Of a bag's readings it is known."
            ),
        ),
    ] = None,
    fix_topic: Annotated[
        str,
        typer.Option("--fix-topic", metavar="TOPIC", help="Of a bag: the navigator's position."),
    ] = "nav/fix",
    matcher: Annotated[
        str | None,
        typer.Option("--matcher", metavar="NAME", help="Matching algorithm; default: pmht."),
    ] = None,
    batch_length: Annotated[
        int | None,
        typer.Option("--batch-length", metavar="T", help="Readings matched at once; default: 30."),
    ] = None,
    stride: Annotated[
        int | None,
        typer.Option("--stride", help="Readings between fixes; default: the batch length."),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Any key matcher.*, e.g. matcher.options.samples=4096; repeatable.",
        ),
    ] = None,
    chain: Annotated[
        bool,
        typer.Option(
            "--chain",
            help="Each batch starts from what the earlier ones told, as an aided navigator would.",
        ),
    ] = False,
    prior_sigma: Annotated[
        float,
        typer.Option(
            "--prior-sigma",
            metavar="M",
            help="1-sigma of the track's position, m per axis.",
            rich_help_panel=_PRIOR,
        ),
    ] = 1000.0,
    velocity_sigma: Annotated[
        float,
        typer.Option(
            "--velocity-sigma",
            metavar="M/S",
            help="1-sigma of the track's velocity, constant over a batch, m/s per axis.",
            rich_help_panel=_PRIOR,
        ),
    ] = 0.0,
    walk_sigma: Annotated[
        float,
        typer.Option(
            "--walk-sigma",
            metavar="M",
            help="With --chain: how far the track's error walks between batches, m in an hour.",
            rich_help_panel=_PRIOR,
        ),
    ] = 0.0,
    sensor_sigma: Annotated[
        float | None,
        typer.Option(
            "--sensor-sigma",
            help=(
                "1-sigma of a reading, where the track has no column sigma; default for gravity: 1"
                " mGal."
            ),
            rich_help_panel=_PRIOR,
        ),
    ] = None,
    map_sigma: Annotated[
        str | None,
        typer.Option(
            "--map-sigma",
            help=(
                "1-sigma of the map's error, or auto; default: what the map says (it counts where"
                " it is larger), else 0."
            ),
            rich_help_panel=_PRIOR,
        ),
    ] = None,
    map_correlation_length: Annotated[
        float | None,
        typer.Option(
            "--map-correlation-length",
            metavar="M",
            help="Its correlation length, m; default: what the map says, else 4000.",
            rich_help_panel=_PRIOR,
        ),
    ] = None,
    reference: Annotated[
        list[Path] | None,
        typer.Option(
            "--reference",
            metavar="FILE",
            help=(
                "Track like --track (CSV), near by and with true positions: the map's error is"
                " learnt from it; repeatable."
            ),
            rich_help_panel=_PRIOR,
        ),
    ] = None,
    bias_sigma: Annotated[
        float | None,
        typer.Option(
            "--bias-sigma",
            help="1-sigma of an unknown constant in the readings; default: 0.",
            rich_help_panel=_PRIOR,
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            "--report",
            metavar="DIR",
            help="Folder for a report with figures.",
            rich_help_panel=_OUT,
        ),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print the results as JSON.", rich_help_panel=_OUT)
    ] = False,
) -> None:
    """Match a recorded track of any scalar field against a map: a fix for every batch of readings.

    The fixes and their covariances are those of the measurements alone.
    """
    from isogal.tracks.matching import Uncertainty, match_track
    from isogal.tracks.results import as_json, as_objects, write_results, writer_for
    from isogal.tracks.track import fit_to_map

    for path in out or ():
        writer_for(path)
    uncertainty = Uncertainty(prior_sigma, velocity_sigma, walk_sigma)
    overrides = _overrides(set_, matcher, batch_length, stride, map_correlation_length)
    recorded, field_map, factor = _load(
        map_,
        variable,
        quantity,
        unit,
        track,
        track_unit,
        sensor_sigma,
        reduction,
        fix_topic,
        prior_sigma,
    )
    if reference:
        field_map = _with_learnt_error(field_map, reference, factor)
    recorded, off_map = fit_to_map(recorded, field_map)
    settings = _settings(overrides, field_map, factor, map_sigma, bias_sigma)
    if reduction is None:
        settings = _with_unknown_latitude(
            settings, recorded, field_map, prior_sigma, factor, track_unit or field_map.file_unit
        )
    if off_map.any():
        _say(
            f"{recorded.where}: the map has no value at {int(off_map.sum())} of {len(recorded)}"
            " readings; left out"
        )
    matches = match_track(recorded, field_map, settings, uncertainty, chained=chain)
    objects = as_objects(matches, chain)
    for path in out or ():
        write_results(objects, path)
    if report is not None:
        from isogal.tracks.match_report import write_match_report

        write_match_report(
            recorded, field_map, settings, uncertainty, matches, report, chained=chain
        )
    if json:
        sys.stdout.write(as_json(objects))
    else:
        _print_table(matches)


def _say(message: str) -> None:
    print(f"isogal: {message}", file=sys.stderr)


def _load(
    map_: Path,
    variable: str | None,
    quantity: str | None,
    unit: str | None,
    track: Path,
    track_unit: str | None,
    sensor_sigma: float | None,
    reduction: str | None,
    fix_topic: str,
    prior_sigma: float,
) -> "tuple[Track, FieldMap, float]":
    """Read track and map; return them and the number of units inside in one unit of the track."""
    from isogal.maps.load import load_map
    from isogal.maps.quantities import unit_factor
    from isogal.tracks.csv_file import read_csv_track
    from isogal.tracks.recording import Recording, is_recording, read_recording

    if sensor_sigma is not None and not sensor_sigma > 0.0:
        raise InputError(f"--sensor-sigma: must be > 0, is {sensor_sigma}")
    if not track.exists():
        raise InputError(f"{track}: no such file or folder")
    source = read_recording(track, fix_topic) if is_recording(track) else read_csv_track(track)
    field_map = load_map(map_, variable, quantity, source.window(_margin(prior_sigma)), unit=unit)
    factor = field_map.file_factor
    if track_unit is not None:
        inside, factor = unit_factor(track_unit, "--track-unit")
        if inside != field_map.unit:
            raise InputError(
                f"--track-unit: '{track_unit}' does not fit a {field_map.quantity} map, which is"
                f" in {field_map.file_unit}"
            )
    sigma = None if sensor_sigma is None else sensor_sigma * factor
    if isinstance(source, Recording):
        return source.track(field_map.quantity, sigma), field_map, factor
    if sigma is None and field_map.unit == "m/s²":
        sigma = _DEFAULT_GRAVITY_SIGMA
    return source.track(factor, sigma, reduction or "none"), field_map, factor


def _with_learnt_error(field_map: "FieldMap", references: list[Path], factor: float) -> "FieldMap":
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
    sigma = np.concatenate(
        [np.ravel(learnt.sigma_at(one.latitude, one.longitude)) for one in tracks]
    )
    _say(
        f"learnt from {sum(len(one) for one in tracks)} readings: map error"
        f" {np.nanmedian(sigma) / factor:.3g} (median there), correlated over"
        f" {fit.correlation_length:.0f} m; readings good to {fit.sensor_sigma / factor:.2g}"
    )
    return learnt


def _margin(prior_sigma: float) -> float:
    """m of map kept around a track."""
    return 25_000.0 + 5.0 * prior_sigma


def _overrides(
    set_: list[str] | None,
    matcher: str | None,
    batch_length: int | None,
    stride: int | None,
    length: float | None,
) -> list[str]:
    items = list(set_ or ())
    for item in items:
        if not item.startswith("matcher."):
            raise InputError(f"--set {item}: only keys that begin with matcher. count here")
    given = {
        "name": matcher,
        "batch_length": batch_length,
        "stride": stride,
        "map_correlation_length": length,
    }
    return items + [f"matcher.{key}={value}" for key, value in given.items() if value is not None]


def _settings(
    overrides: list[str],
    field_map: "FieldMap",
    factor: float,
    map_sigma: str | None,
    bias_sigma: float | None,
) -> "Matcher":
    """Return the matcher's section: sigmas of the options are in the track's unit, those of --set
    in the unit inside."""
    from isogal.scenario import load_scenario

    if bias_sigma is not None and not bias_sigma >= 0.0:
        raise InputError(f"--bias-sigma: must be >= 0, is {bias_sigma}")
    said = {item.partition("=")[0] for item in overrides}
    items = list(overrides)
    if map_sigma is not None:
        items.append(f"matcher.map_sigma={_scaled('--map-sigma', map_sigma, factor)}")
    if bias_sigma is not None:
        items.append(f"matcher.bias_sigma={bias_sigma * factor!r}")
    if "matcher.map_correlation_length" not in said and field_map.correlation_length is not None:
        items.append(f"matcher.map_correlation_length={field_map.correlation_length!r}")
    settings = load_scenario(None, items).matcher
    if map_sigma is None and "matcher.map_sigma" not in said and not _knows_error(field_map):
        _say(
            "the map does not say how wrong it is and is taken as exact; give --map-sigma, a"
            " number or auto"
        )
    return settings


def _with_unknown_latitude(
    settings: "Matcher",
    track: "Track",
    field_map: "FieldMap",
    prior_sigma: float,
    factor: float,
    unit: str,
) -> "Matcher":
    """Return settings with an unknown constant for normal gravity in the offset, taken at nobody
    knows which latitude."""
    import math

    change = track.normal_gravity_in_doubt(field_map.quantity) * prior_sigma
    if change == 0.0:
        return settings
    _say(
        f"{track.where}: offset holds normal gravity; as it does not say at which latitude, an"
        f" unknown constant of {change / factor:.2g} {unit} is allowed for. Say --reduction"
        " latitude if it was the track's own, else --reduction none"
    )
    return settings.model_copy(update={"bias_sigma": math.hypot(settings.bias_sigma, change)})


def _scaled(option: str, text: str, factor: float) -> str:
    if text == "auto":
        return text
    try:
        return repr(float(text) * factor)
    except ValueError:
        raise InputError(f"{option}: must be a number or auto, not '{text}'") from None


def _knows_error(field_map: "FieldMap") -> bool:
    import numpy as np

    return bool(np.any(np.nan_to_num(field_map.sigma) > 0.0))


def _print_table(matches: "list[Match]") -> None:
    import numpy as np
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, header_style="bold")
    columns: list[tuple[str, Any]] = [
        ("time (s)", "right"),
        ("latitude", "right"),
        ("longitude", "right"),
        ("1-sigma (m)", "right"),
        ("", "left"),
    ]
    for name, justify in columns:
        table.add_column(name, justify=justify)
    for match in matches:
        fix = match.fix
        if fix.published:
            axes = np.sqrt(np.linalg.eigvalsh(fix.covariance))[::-1]
            row = [
                f"{np.degrees(fix.latitude):.5f}",
                f"{np.degrees(fix.longitude):.5f}",
                f"{axes[0]:.0f} x {axes[1]:.0f}",
                "",
            ]
        else:
            row = ["-", "-", "-", f"no fix: {fix.reason}"]
        table.add_row(f"{fix.time:.10g}", *row)
    console = Console(highlight=False, soft_wrap=True)
    console.print(table)
    console.print(f"{sum(m.fix.published for m in matches)} fixes of {len(matches)} batches")
