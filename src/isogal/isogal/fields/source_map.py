"""The map that a scenario names: synthetic, or read from where it says."""

from dataclasses import dataclass
from typing import Self, TypeVar

from isogal import plugins
from isogal.errors import InputError
from isogal.fields.measured import measured_field
from isogal.maps.axes import Window
from isogal.maps.corridor import Corridor
from isogal.maps.field_map import FieldMap
from isogal.maps.load import load_map
from isogal.maps.tiled_map import ScalarMap, map_along
from isogal.scenario import Map, Settings

SYNTHETIC = "synthetic"
_SYNTHETIC_VARIABLES = {"ga": "gravity", "dg": "disturbance"} | {
    name: name for name in ("gravity", "disturbance", "height")
}
_SomeMap = TypeVar("_SomeMap", bound=ScalarMap)


@dataclass(frozen=True, slots=True)
class MapSource:
    """One variable of the map that a scenario names. Called with a window it reads what is there,
    whole and in memory (`isogal.maps.tiled_map.Load`)."""

    settings: Map
    quantity: str | None
    """What the map has to be of; None = anything."""
    key: str = "field"
    """Key of the scenario that asks for it, for messages."""
    asked: str = ""
    """What that key says."""

    @classmethod
    def of(cls, settings: Settings) -> Self:
        """Return the source of the map that the field of a scenario needs; raises InputError as
        `measured_field` does."""
        field = measured_field(settings)
        needs = "" if field.channels is None else f", which needs one of {field.source}"
        key = "field" if settings.field else "gravimeter.quantity"
        return cls(settings.map, field.source, key, settings.measured_field + needs)

    def other(self, quantity: str | None, variable: str | None = None) -> "MapSource":
        """Return the source of another quantity, or variable, of the same map."""
        settings = self.settings.model_copy(update={"variable": variable})
        return MapSource(settings, quantity, self.key, quantity or "")

    def __call__(self, *, window: Window) -> FieldMap:
        """Return the map in a window.

        Raises
        ------
        InputError
            It cannot be read, is of another quantity, or is too large.
        """
        if self.settings.source == SYNTHETIC:
            from isogal.maps.synthetic.synthetic_map import synthetic_map

            return self._checked(synthetic_map(self._synthetic, window))
        return self._checked(self._read(window))

    def along(self, corridor: Corridor) -> ScalarMap:
        """Return the map along a route, tiled if it is large; raises InputError as a call does."""
        if self.settings.source == SYNTHETIC:
            from isogal.maps.synthetic.synthetic_map import synthetic_map_along  # slow to import

            return self._checked(synthetic_map_along(self._synthetic, corridor))
        return map_along(self, corridor)

    def _read(self, window: Window) -> FieldMap:
        source, path, variable = self.settings.source, self.settings.path, self.settings.variable
        named = source in plugins.names(plugins.MAP_FORMATS)
        if named and path is None:
            raise InputError(
                "map.path: must name the file or folder, since map.source is the format"
                f" '{source}'"
            )
        if not named and path is not None:
            raise InputError(
                "map.source: must be 'synthetic' or a format"
                f" ({', '.join(plugins.names(plugins.MAP_FORMATS))}) where map.path is given"
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
                f"map: {field_map.provenance} is a {field_map.quantity} map, but {self.key} is"
                f" {self.asked}; change map.variable or {self.key}"
            )
        return field_map

    @property
    def _synthetic(self) -> str:
        """Quantity of the synthetic map."""
        variable = self.settings.variable
        if variable is None:
            return self.quantity or ""
        if variable not in _SYNTHETIC_VARIABLES:
            raise InputError(
                f"map.variable: the synthetic map has height, ga and dg, not '{variable}'"
            )
        return _SYNTHETIC_VARIABLES[variable]
