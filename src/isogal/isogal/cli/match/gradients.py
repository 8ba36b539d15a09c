"""A track of a gradiometer: its readings, and the maps that they are compared with."""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from isogal.cli.errors import note
from isogal.cli.map_choice import MapChoice
from isogal.cli.match.inputs import Inputs, unit_of, without_crs
from isogal.cli.match.options import Assumptions
from isogal.cli.match.track_choice import TrackChoice
from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.maps.field_map import FieldMap
    from isogal.scenario import Gradiometer

_REACH = 20_000.0
"""m, within which of a map's edge its gradients are not known."""
_MARGIN = 5_000.0
"""m of gradients kept around a track, and five 1-sigmas of its position."""
_DEFAULT_SIGMA = 1.0e-9
"""1/s², as `gradiometer.sigma_eotvos` of a scenario."""
_UNIT = "E"


def read_gradients(map_: MapChoice, chosen: TrackChoice, assumed: Assumptions) -> list[Inputs]:
    """Read tracks of a gradiometer, and compute the maps of its components.

    Raises
    ------
    InputError
        A file cannot be read, the map is not of the disturbance, or options do not go together.
    """
    import numpy as np

    from isogal.maps.gradients import tensor_maps
    from isogal.tracks.csv_file import read_csv_tracks
    from isogal.tracks.fields import ChannelReadings
    from isogal.tracks.track import fit_to_map

    components = _components(chosen, assumed)
    lines = zip(
        *(
            read_csv_tracks(chosen.track, map_.crs, (f"t_{name}", f"t{name}", name))
            for name in components
        ),
        strict=True,
    )
    found = []
    for line in lines:
        first = line[0]
        own = without_crs(map_) if first.projected else map_
        corridor = first.corridor(_REACH + _MARGIN + 5.0 * assumed.prior_sigma)
        disturbance = own.load(corridor.window, "disturbance")
        rise = _rise(chosen, disturbance)
        maps = tensor_maps(disturbance, components, height=rise, edge=_REACH)
        scalar = maps.channels[0]
        unit, factor = unit_of(chosen.track_unit or _UNIT, scalar)
        sigma = assumed.reading_sigma(scalar, factor) or _DEFAULT_SIGMA
        values = np.stack([one.value for one in line], axis=1) * factor
        nothing = np.zeros(len(first))
        track = replace(first, sigma=nothing + math.nan, offset=nothing).in_unit(factor, sigma)
        track, off_map = fit_to_map(track, scalar)
        if off_map.any():
            note(
                f"{track.where}: gradients are not known at {int(off_map.sum())} of {len(track)}"
                " readings as recorded"
            )
        instrument = _instrument(components, chosen)
        readings = ChannelReadings(values, sigma**2 * np.eye(len(components)), instrument)
        found.append(Inputs(track, maps, unit, factor, first.line, readings))
    return found


def _components(chosen: TrackChoice, assumed: Assumptions) -> tuple[str, ...]:
    """Return the components; raises InputError where options do not go with them."""
    for option, given in (
        ("--reference", assumed.reference),
        ("--spacing", chosen.spacing),
        ("--reduction", chosen.reduction),
        ("--compensation", chosen.compensation),
        ("--base", chosen.base),
    ):
        if given:
            raise InputError(f"{option}: does not go with --gradients")
    names = [one.strip().casefold() for one in (chosen.gradients or "").split(",")]
    return tuple(name for name in names if name)


def _instrument(components: tuple[str, ...], chosen: TrackChoice) -> "Gradiometer":
    """Return what the options say of the gradiometer; raises InputError where it cannot be."""
    from pydantic import ValidationError

    from isogal.scenario import Gradiometer
    from isogal.scenario.messages import describe

    try:
        return Gradiometer(
            components=components,
            allowed_tilt=chosen.tilt_sigma,
            bias_eotvos=chosen.offset_sigma,
            bias_walk_eotvos=chosen.offset_walk,
            map_errors="one_potential" if chosen.one_potential else "independent",
        )
    except ValidationError as error:
        raise InputError(describe(error, Gradiometer)) from None


def _rise(chosen: TrackChoice, disturbance: "FieldMap") -> float:
    """Return how far (m) the readings were taken above the level of the map's values."""
    if chosen.height is None:
        return 0.0
    level = disturbance.height if chosen.map_height is None else chosen.map_height
    if level is None:
        raise InputError(
            f"--height {chosen.height:g}: {disturbance.provenance} does not say what level its"
            " values hold on; give --map-height"
        )
    if chosen.height < level:
        raise InputError(
            f"--height {chosen.height:g}: is below the map's level, {level:g} m: a map cannot be"
            " continued down towards the masses"
        )
    return chosen.height - level
