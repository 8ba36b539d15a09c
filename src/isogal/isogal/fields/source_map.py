"""The map that a scenario names: synthetic, or read from where it says; and what it is at the
height of the flight (docs/maps.md, section "At the height of the flight").

Where the values hold is said by `map.terrain` (on the ground; the vehicle goes on a level), or by
`map.level` or the map itself (on a level). If nothing says it they hold on the map's surface, and
the vehicle goes `route.height` above that everywhere. There a map of gravity changes as the
disturbance does: what else is in it is the height of the surface itself. So the source has to hold
a map of the disturbance as well; otherwise it is taken as it is."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Self, TypeVar

import numpy as np

from isogal import plugins
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.fields.measured import measured_field
from isogal.maps.axes import Window
from isogal.maps.continuation.blocks import CONTINUED, continued, rim_of
from isogal.maps.corridor import Corridor
from isogal.maps.field_map import FieldMap
from isogal.maps.load import load_map
from isogal.maps.tiled_map import Load, ScalarMap, TiledMap, map_along
from isogal.scenario import Map, Settings

SYNTHETIC = "synthetic"
_RIM_ON_GROUND = 20_000.0
"""m of the ground around a place that are taken into account at least."""
_SomeMap = TypeVar("_SomeMap", bound=ScalarMap)


@dataclass(frozen=True, slots=True)
class MapSource:
    """One variable of the map that a scenario names. Called with a window it reads what is there,
    whole and in memory (`isogal.maps.tiled_map.Load`)."""

    settings: Map
    quantity: str | None
    """What the map has to be of; None = anything."""
    read: Load | None = None
    """Reads what is in a window, in place of what the scenario names."""

    @classmethod
    def of(cls, settings: Settings) -> Self:
        """Return the source of the map that the field of a scenario needs; raises InputError as
        `measured_field` does."""
        return cls(settings.map, measured_field(settings).source)

    def other(self, quantity: str | None, variable: str | None = None) -> "MapSource":
        """Return the source of another quantity, or variable, of the same map."""
        settings = self.settings.model_copy(update={"variable": variable})
        return MapSource(settings, quantity)

    def __call__(self, window: Window) -> FieldMap:
        """Return the map in a window.

        Raises
        ------
        InputError
            It cannot be read, is of another quantity, or is too large.
        """
        if self.read is not None:
            return self.read(window)
        if self.settings.source == SYNTHETIC:
            from isogal.maps.synthetic.synthetic_map import synthetic_map

            return self._checked(synthetic_map(self._synthetic, window))
        return self._checked(self._named(window))

    def along(self, corridor: Corridor) -> ScalarMap:
        """Return the map along a route, tiled if it is large; raises InputError as a call does."""
        if self.settings.source == SYNTHETIC:
            from isogal.maps.synthetic.synthetic_map import synthetic_map_along  # slow to import

            return self._checked(synthetic_map_along(self._synthetic, corridor))
        return map_along(self, corridor)

    def flown(self, height: float, window: Window) -> FieldMap:
        """Return the map in a window at the height of the flight (m, as `route.height`).

        Raises
        ------
        InputError
            The map cannot be read, or not be continued.
        """
        field_map = self(window)
        if not self.continues(field_map, height):
            return field_map
        rise = height - (self._level(field_map) or 0.0)
        reach = rim_of(rise, self.settings.downward_cutoff)
        if self.settings.terrain is not None:
            reach = max(reach, _RIM_ON_GROUND)
        wide = window.grown(reach)._replace(most_cells=2 * window.most_cells)
        try:
            return self._continued(self(wide), height, wide, window).window(*window[:4])
        except InputError as error:
            raise InputError(
                f"{error} (the map at route.height; with map.continuation: none it is taken as it"
                " is)"
            ) from None

    def flown_along(self, height: float, field_map: ScalarMap, corridor: Corridor) -> ScalarMap:
        """Return the map along a route at the height of the flight (m); `field_map` is what the
        source says of it. Raises InputError as `flown` does."""
        if not self.continues(field_map, height):
            return field_map
        flown = partial(self.flown, height)
        if isinstance(field_map, FieldMap):
            return flown(corridor.window)
        if self.settings.terrain is not None:
            raise InputError(
                "map.terrain: the map is too large to be continued from the ground on the way;"
                " make one at the height of the flight with isogal map continue"
            )
        return TiledMap(flown, corridor)

    def continues(self, field_map: ScalarMap, height: float) -> bool:
        """Tell whether the source's map has to be continued to the height of the flight (m)."""
        if self.settings.continuation == "none" or field_map.quantity not in CONTINUED:
            return False
        if self.settings.terrain is not None:
            return True
        level = self._level(field_map)
        if height == (level or 0.0):
            return False
        if level is not None or field_map.quantity != "gravity":
            return True
        south, north, west, east = field_map.extent[:4]
        middle = 0.5 * (south + north), 0.5 * (west + east)
        window = Window(middle[0], middle[0], middle[1], middle[1]).grown(_RIM_ON_GROUND)
        return self._disturbance(window) is not None

    def for_gradients(self, source: FieldMap, height: float) -> tuple[FieldMap, float]:
        """Return a map of the disturbance on a level, and how far (m) the vehicle, at a height (m,
        as `route.height`), goes above that.

        Raises
        ------
        InputError
            The vehicle goes below it.
        """
        if self.settings.terrain is not None:
            return _from_ground(self.settings.terrain, height, source), 0.0
        rise = height - (self._level(source) or 0.0)
        if rise < 0.0:
            raise InputError(
                f"route.height: must not be below the map's level where field is gradient, is"
                f" {-rise:g} m below it: a map cannot be continued down towards the masses"
            )
        return source, rise

    def _level(self, field_map: ScalarMap) -> float | None:
        """Return the height (m, counted as `route.height`) of the level that a map's values hold
        on; None where neither scenario nor map says it."""
        return field_map.height if self.settings.level is None else self.settings.level

    def _disturbance(self, window: Window) -> FieldMap | None:
        """Return the map of the disturbance that the source of a map of gravity holds as well."""
        try:
            return self.other("disturbance")(window)
        except InputError:
            return None

    def _continued(
        self, source: FieldMap, height: float, wide: Window, window: Window
    ) -> FieldMap:
        """Return the map in a wide window at the height of the flight, with values where they are
        needed: in another window at least."""
        if self.settings.terrain is not None:
            return _from_ground(self.settings.terrain, height, source)
        level = self._level(source)
        cutoff = self.settings.downward_cutoff if height < (level or 0.0) else None
        if level is not None or source.quantity != "gravity":
            above = continued(source, height, level or 0.0, cutoff=cutoff, window=window)
            return above if level is not None else replace(above, height=None)
        disturbance = self._disturbance(wide)
        if disturbance is None or disturbance.values.shape != source.values.shape:
            raise InputError(f"{source.provenance}: the disturbance beside it is on another grid")
        return _changed_as(source, disturbance, height, cutoff, window)

    def _named(self, window: Window) -> FieldMap:
        source, path, variable = self.settings.source, self.settings.path, self.settings.variable
        formats = plugins.names(plugins.MAP_FORMATS)
        named = source in formats
        if named == (path is None):
            raise InputError(
                "map.source: must be 'synthetic' or a file, or a format"
                f" ({', '.join(formats)}) with the file as map.path"
            )
        return load_map(
            source if path is None else path,
            variable,
            None if variable else self.quantity,
            window,
            format_name=source if named else None,
        )

    def _checked(self, field_map: _SomeMap) -> _SomeMap:
        if self.quantity not in (None, field_map.quantity):
            raise InputError(
                f"map: {field_map.provenance} is a {field_map.quantity} map, and one of"
                f" {self.quantity} is needed; change map.variable, field or gravimeter.quantity"
            )
        return field_map

    @property
    def _synthetic(self) -> str:
        """Quantity of the synthetic map."""
        from isogal.maps.synthetic.synthetic_map import quantity_of

        variable = self.settings.variable
        return (self.quantity or "") if variable is None else quantity_of(variable, "map.variable")


def _changed_as(
    source: FieldMap,
    disturbance: FieldMap,
    height: float,
    cutoff: float | None,
    window: Window,
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
    window : Window
        Where the result is needed.
    """
    below = replace(
        disturbance,
        sigma=source.sigma,
        correlation_length=source.correlation_length,
        quantisation=0.0,
        provenance=source.provenance,
    )
    above = continued(below, height, 0.0, cutoff=cutoff, window=window)
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

    ground = MapSource(Map(source=terrain), "height")(source.extent)
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
