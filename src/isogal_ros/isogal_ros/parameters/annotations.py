"""What a field of a pydantic model may hold, from its annotation."""

import math
import types
import typing
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

from pydantic.fields import FieldInfo


@dataclass(frozen=True)
class Content:
    """What a field may hold."""

    type: Any
    """The annotation without null, constraints and words; float for a number that may also be a
    word."""
    nullable: bool
    constraints: tuple[Any, ...]
    """Of annotated-types: `ge`, `gt`, `le`, `lt`."""
    words: tuple[str, ...] = ()
    """What a number may be instead of a number."""

    def bounds(self) -> tuple[Any, Any]:
        """Return the lowest and the highest number allowed; None = any."""
        lows, highs = [], []
        for item in self.constraints:
            lows += [item.ge] if getattr(item, "ge", None) is not None else []
            highs += [item.le] if getattr(item, "le", None) is not None else []
            if getattr(item, "gt", None) is not None:
                lows.append(self._next(item.gt, math.inf))
            if getattr(item, "lt", None) is not None:
                highs.append(self._next(item.lt, -math.inf))
        return max(lows, default=None), min(highs, default=None)

    def _next(self, value: Any, towards: float) -> Any:
        """Return the next number of the field's type."""
        if self.type is int:
            return value + int(math.copysign(1, towards))
        return math.nextafter(value, towards)


def content_of(field: FieldInfo) -> Content:
    """Return what a field may hold."""
    return _unwrapped(field.annotation, False, tuple(field.metadata))


def _unwrapped(annotation: Any, nullable: bool, constraints: tuple[Any, ...]) -> Content:
    origin, members = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        annotation, *more = members
        return _unwrapped(annotation, nullable, constraints + tuple(_flat(more)))
    if origin not in (typing.Union, types.UnionType):
        return Content(annotation, nullable, constraints)
    some = [member for member in members if member is not type(None)]
    nullable = nullable or len(some) < len(members)
    if len(some) == 1:
        return _unwrapped(some[0], nullable, constraints)
    words = [member for member in some if typing.get_origin(member) is Literal]
    if len(some) == 2 and words:
        return Content(float, nullable, constraints, typing.get_args(words[0]))
    return Content(annotation, nullable, constraints)


def _flat(metadata: Iterable[Any]) -> Iterable[Any]:
    """Yield constraints; pydantic's `Field` inside an annotation keeps them in a list of its
    own."""
    for item in metadata:
        yield from getattr(item, "metadata", [item])
