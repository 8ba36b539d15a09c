"""A scenario's map at the height where its vehicle goes (docs/maps.md, section "At the height of
the flight").

Where the values hold is said by `map.terrain` (on the ground; the vehicle goes on a level), or by
`map.level` or the map itself (on a level). If nothing says it they hold on the map's surface, and
the vehicle goes `route.height` above that everywhere. There a map of gravity changes as the
disturbance does: what else is in it is the height of the surface itself. So the source has to hold
a map of the disturbance as well; otherwise it is taken as it is."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.fields.source_map import MapSource
from isogal.maps.axes import Window
from isogal.maps.continuation.blocks import CONTINUED, continued, rim_of
from isogal.maps.field_map import FieldMap
from isogal.maps.tiled_map import ScalarMap
from isogal.scenario import Map, Settings

_RIM_ON_GROUND = 20_000.0
"""m of the ground around a place that are taken into account at least."""


@dataclass(frozen=True, slots=True)
class FlownMap:
    """A map at the height of the flight. Called with a window it reads and continues what is
    there, whole and in memory (`isogal.maps.tiled_map.Load`)."""

    source: MapSource
    height: float
    """m, as `route.height`."""

    @classmethod
    def of(cls, settings: Settings) -> Self:
        """Return that of what a scenario measures; raises InputError as `MapSource.of` does."""
        return cls(MapSource.of(settings), settings.route.height)

    def __call__(self, *, window: Window) -> FieldMap:
        """Return the map in a window.

        Raises
        ------
        InputError
            The map cannot be read, or not be continued.
        """
        field_map = self.source(window=window)
        if not self.continues(field_map):
            return field_map
        wide = window.grown(self._reach(field_map))._replace(most_cells=2 * window.most_cells)
        try:
            return self._continued(self.source(window=wide), wide).window(*window[:4])
        except InputError as error:
            raise InputError(
                f"{error} (the map at route.height; with map.continuation: none it is taken as it"
                " is)"
            ) from None

    def continues(self, field_map: ScalarMap) -> bool:
        """Tell whether the source's map has to be continued to the flown height."""
        settings = self.source.settings
        if settings.continuation == "none" or field_map.quantity not in CONTINUED:
            return False
        if settings.terrain is not None:
            return True
        level = stated_level(settings, field_map)
        if self.height == (level or 0.0):
            return False
        if level is not None or field_map.quantity != "gravity":
            return True
        south, north, west, east = field_map.extent[:4]
        middle = 0.5 * (south + north), 0.5 * (west + east)
        window = Window(middle[0], middle[0], middle[1], middle[1]).grown(_RIM_ON_GROUND)
        return self._disturbance(window) is not None

    def _disturbance(self, window: Window) -> FieldMap | None:
        """Return the map of the disturbance that the source of a map of gravity holds as well."""
        try:
            return self.source.other("disturbance")(window=window)
        except InputError:
            return None

    def _reach(self, field_map: FieldMap) -> float:
        """Return how far (m) beyond a place the map is needed to continue it there."""
        settings = self.source.settings
        rise = self.height - (stated_level(settings, field_map) or 0.0)
        rim = rim_of(rise, settings.downward_cutoff)
        return rim if settings.terrain is None else max(rim, _RIM_ON_GROUND)

    def _continued(self, source: FieldMap, window: Window) -> FieldMap:
        settings = self.source.settings
        if settings.terrain is not None:
            return _from_ground(settings.terrain, self.height, source)
        level = stated_level(settings, source)
        cutoff = settings.downward_cutoff if self.height < (level or 0.0) else None
        if level is not None or source.quantity != "gravity":
            above = continued(source, self.height, level or 0.0, cutoff=cutoff)
            return above if level is not None else replace(above, height=None)
        disturbance = self._disturbance(window)
        if disturbance is None or disturbance.values.shape != source.values.shape:
            raise InputError(f"{source.provenance}: the disturbance beside it is on another grid")
        return _changed_as(source, disturbance, self.height, cutoff)


def stated_level(settings: Map, field_map: ScalarMap) -> float | None:
    """Return the height (m, counted as `route.height`) of the level that a map's values hold on;
    None where neither scenario nor map says it."""
    return field_map.height if settings.level is None else settings.level


def disturbance_for_gradients(
    settings: Map, height: float, source: FieldMap
) -> tuple[FieldMap, float]:
    """Return a map of the disturbance on a level, and how far (m) the vehicle, at `route.height`,
    goes above that.

    Raises
    ------
    InputError
        The vehicle goes below it.
    """
    if settings.terrain is not None:
        return _from_ground(settings.terrain, height, source), 0.0
    rise = height - (stated_level(settings, source) or 0.0)
    if rise < 0.0:
        raise InputError(
            f"route.height: must not be below the map's level where field is gradient, is"
            f" {-rise:g} m below it: a map cannot be continued down towards the masses"
        )
    return source, rise


def _changed_as(
    source: FieldMap, disturbance: FieldMap, height: float, cutoff: float | None
) -> FieldMap:
    """Return a map of gravity above a surface, changed with height as the disturbance is.

    Parameters
    ----------
    source, disturbance : FieldMap
        On one grid.
    height : float
        Above the surface, m.
    cutoff : float, optional
        Shortest wavelength that is continued downwards, m.
    """
    below = replace(
        disturbance,
        sigma=source.sigma,
        correlation_length=source.correlation_length,
        quantisation=0.0,
        provenance=source.provenance,
    )
    above = continued(below, height, 0.0, cutoff=cutoff)
    return replace(
        above,
        values=source.values + (above.values - below.values),
        quantity="gravity",
        height=None,
        # the change is that of rounded values, too
        quantisation=float(np.hypot(source.quantisation, disturbance.quantisation)),
        file_unit=source.file_unit,
        file_factor=source.file_factor,
    )


def _from_ground(terrain: str, height: float, source: FieldMap) -> FieldMap:
    """Continue a map whose values hold on the ground to a level; `terrain` names the map of the
    ground's height."""
    from isogal.maps.continuation.terrain import from_terrain

    ground = MapSource(Map(source=terrain), "height", "map.terrain", "the ground's height")(
        window=source.extent
    )
    if source.quantity != "gravity":
        return from_terrain(source, ground, height)
    normal = normal_gravity(
        source.latitude[:, None], ground.value(source.latitude[:, None], source.longitude)
    )
    below = replace(source, values=source.values - normal, quantity="disturbance")
    result = from_terrain(below, ground, height)
    # as a reading is reduced: with the mean change with height taken off
    values = result.values.astype(np.float64) + normal_gravity(result.latitude)[:, None]
    return replace(result, values=values, quantity="gravity")
