"""Maps that two cases compute are computed once."""

from helpers.computed_once import maps_once

__all__ = ["maps_once"]
