"""What the sections of a scenario share: strictness, ranges of numbers, and validation whose
errors are one line that names each bad key and what it may be."""

import datetime
import difflib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Annotated, Any, ClassVar, TypeAlias, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidatorFunctionWrapHandler,
    field_validator,
)

from isogal.errors import InputError

LatitudeDeg = Annotated[float, Field(ge=-89.9, le=89.9)]
LongitudeDeg = Annotated[float, Field(ge=-180.0, le=360.0)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Value: TypeAlias = "str | float | Sequence[Value] | Mapping[str, Value] | None"
"""What YAML has for a key."""
Document = dict[str, Any]
"""Keys and values; typed so that pydantic takes it for a field, and what it gives fits it."""
_Model = TypeVar("_Model", bound=BaseModel)


class Section(BaseModel):
    """A section: unknown keys are errors, values do not change, defaults are checked as well."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, validate_default=True, use_attribute_docstrings=True
    )

    errors: ClassVar[tuple[str, ...]] = ()
    """Keys, dotted where a section is inside, that are sizes of errors: `truth` may multiply them
    all at once."""

    @classmethod
    def __pydantic_init_subclass__(cls, **_: object) -> None:
        """Make one line of each key's docstring, which is its description."""
        for field in cls.model_fields.values():
            if field.description is not None:
                field.description = " ".join(field.description.split())

    @field_validator("*", mode="wrap")
    @classmethod
    def _no_number(cls, value: object, validate: ValidatorFunctionWrapHandler) -> object:
        """Refuse true and false where a number belongs; pydantic takes them for 1 and 0."""
        if isinstance(value, bool):
            with suppress(ValidationError):
                if validate(value) is value:
                    return value
        return validate(_without_booleans(value))

    def resolved(self) -> Document:
        """Return the section's values by key. A section that takes defaults from elsewhere puts
        them in place of its own null here, so that `truth` can multiply them."""
        return self.model_dump()


class _Boolean:
    """True or false where neither is allowed: no type of a key takes it."""

    def __init__(self, value: bool) -> None:
        self._value = value

    def __repr__(self) -> str:
        return written(self._value)


def _without_booleans(value: object) -> object:
    """Return a value in which each true and false, also those in lists, is a `_Boolean`."""
    if isinstance(value, list | tuple):
        return [_without_booleans(one) for one in value]
    return _Boolean(value) if isinstance(value, bool) else value


def written(value: object) -> str:
    """Return a value in the words of a scenario file."""
    match value:
        case None:
            return "null"
        case bool():
            return str(value).lower()
        case datetime.date():
            return str(value)
        case list() | tuple():
            return f"[{', '.join(map(written, value))}]"
        case dict():
            return f"{{{', '.join(f'{key}: {written(one)}' for key, one in value.items())}}}"
    return repr(value)


def merged(document: Mapping[str, Value], changes: Mapping[str, Value]) -> Document:
    """Return a document with other values of some keys, section by section."""
    result: Document = dict(document)
    for key, value in changes.items():
        inside = result.get(key)
        if isinstance(inside, Mapping) and isinstance(value, Mapping):
            result[key] = merged(inside, value)
        else:
            result[key] = value
    return result


def validated(model: type[_Model], document: Value, prefix: str = "", where: str = "") -> _Model:
    """Return a document as a model.

    Parameters
    ----------
    model : type of BaseModel
    document : mapping
        Keys and values, as from YAML or `dict` of a model.
    prefix : str
        Goes before each key in an error's line, with its dot.
    where : str
        What the line begins with, with its colon and blank.

    Raises
    ------
    InputError
        One line: every bad key, what it was, what it may be.
    """
    try:
        return model.model_validate(document)
    except ValidationError as error:
        raise InputError(where + describe(error, model, prefix)) from None


def describe(error: ValidationError, model: type[BaseModel], prefix: str = "") -> str:
    """Turn a validation error of a model into one line: every bad key, what it was, what it may
    be. The prefix, with its dot, goes before each key."""
    allowed: dict[tuple[str, str], list[str]] = {}
    for item in error.errors():
        inside = ".".join(str(part) for part in item["loc"] if not _is_type(str(part)))
        key = prefix + inside if inside else prefix.removesuffix(".")
        colon = f"{key}: " if key else ""
        if item["type"] in ("extra_forbidden", "invalid_key"):  # the latter is no text
            allowed[f"unknown key '{key}'{_nearest(inside, model, prefix)}", ""] = []
        elif item["type"] == "value_error":
            text = str(item["ctx"]["error"])
            within = f"{key}.{text}".partition(":")[0] in known_keys(model, prefix)
            allowed[f"{key}.{text}" if within else f"{colon}{text}", ""] = []
        elif item["type"] == "missing":
            allowed[f"{colon}must be given", ""] = []
        else:
            ends = f"{colon}must be ", f", not {written(item['input'])}"
            allowed.setdefault(ends, []).append(_allowed(item))
    return "; ".join(
        begin + " or ".join(dict.fromkeys(words)) + end for (begin, end), words in allowed.items()
    )


_ALLOWED = {
    "bool": "true or false",
    "int": "a whole number",
    "float": "a number",
    "finite": "a finite number",
    "string": "a text",
    "literal": "{expected}",
    "tuple": "a list",
    "list": "a list",
    "dict": "a section of keys",
    "model": "a section of keys",
    "greater_than": "greater than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
    "too_short": "a list of {min_length} or more",
    "too_long": "a list of {max_length} or fewer",
    "string_too_short": "a text of {min_length} or more characters",
    "string_pattern_mismatch": "a text like {pattern}",
}
"""What a value may be, by the type of pydantic's error or the word that such types begin with."""


def _allowed(item: Mapping[str, Any]) -> str:
    """Return what the value of one of pydantic's errors may be, in words after "must be"."""
    kind = item["type"]
    words = _ALLOWED.get(kind) or _ALLOWED.get(kind.partition("_")[0])
    return words.format(**item.get("ctx", {})) if words else f"otherwise ({item['msg']})"


def known_keys(model: type[BaseModel], prefix: str = "") -> list[str]:
    """List all dotted keys of a model."""
    keys = []
    for name, field in model.model_fields.items():
        keys.append(prefix + name)
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            keys += known_keys(field.annotation, f"{prefix}{name}.")
    return keys


def suggestion(key: str, known: Sequence[str], cutoff: float = 0.6) -> str | None:
    """Return ", did you mean '...'?" with the known key that is most like a wrong one, or that
    only goes on after it; None where none is like it."""
    leaves = {k.rpartition(".")[2]: k for k in known}
    close = [name for name in leaves if key and name.startswith(f"{key}_")]
    close = close or difflib.get_close_matches(key, leaves, n=1, cutoff=cutoff)
    return f", did you mean '{leaves[close[0]]}'?" if close else None


def _is_type(part: str) -> bool:
    """Whether a part of an error's location is not a key but one of the types a value may have."""
    return part == "float" or part.startswith(("function-", "constrained-", "literal[", "tuple["))


def _nearest(key: str, model: type[BaseModel], prefix: str) -> str:
    """Suggest a key of the same section with a similar name, or of any section with that name, or
    list the section's keys."""
    section, _, leaf = key.rpartition(".")
    keys = [prefix + known for known in known_keys(model)]
    siblings = [
        known for known in keys if known.rpartition(".")[0] == (prefix + section).strip(".")
    ]
    allowed = f"; allowed: {', '.join(siblings)}" if siblings else ""
    return suggestion(leaf, siblings) or suggestion(leaf, keys, 0.8) or allowed
