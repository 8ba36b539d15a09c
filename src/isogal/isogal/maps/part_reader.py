"""How parts of a map are read."""

from typing import Protocol

from isogal.maps.axes import Window
from isogal.maps.field_map import FieldMap


class Load(Protocol):
    """How a part of a map is read: a function, which can be pickled if the map is sent to other
    processes."""

    def __call__(self, *, window: Window) -> FieldMap:
        """Read what the map has in a window, with the nodes around it that interpolation needs.

        Raises
        ------
        EmptyWindowError
            There is nothing.
        TooManyCellsError
            There is more than the window allows.
        InputError
            The map cannot be read.
        """
        ...
