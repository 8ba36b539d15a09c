"""Validation errors as one line that names each bad key and what it may be."""

import difflib

from pydantic import BaseModel, ValidationError

from isogal.scenario.model import Scenario


def describe(error: ValidationError, model: type[BaseModel] = Scenario, prefix: str = "") -> str:
    """Turn a validation error of a model into one line: every bad key, what it was, what it may
    be. The prefix, with its dot, goes before each key."""
    parts = []
    for item in error.errors():
        inside = ".".join(str(part) for part in item["loc"] if not _is_type(str(part)))
        key = prefix + inside if inside else prefix.removesuffix(".")
        if item["type"] == "extra_forbidden":
            parts.append(f"unknown key '{key}'{_nearest(inside, model, prefix)}")
        elif item["type"] == "value_error":
            parts.append(f"{key + ': ' if key else ''}{item['msg'].removeprefix('Value error, ')}")
        else:
            message = item["msg"][0].lower() + item["msg"][1:]
            parts.append(f"{key}: {message}, not {item['input']!r}")
    return "; ".join(dict.fromkeys(parts))


def known_keys(model: type[BaseModel] = Scenario, prefix: str = "") -> list[str]:
    """List all dotted keys of a scenario, or of another model."""
    keys = []
    for name, field in model.model_fields.items():
        keys.append(prefix + name)
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            keys += known_keys(field.annotation, f"{prefix}{name}.")
    return keys


def _is_type(part: str) -> bool:
    """Whether a part of an error's location is not a key but one of the types a value may have."""
    return part == "float" or part.startswith(("function-", "constrained-", "literal[", "tuple["))


def _nearest(key: str, model: type[BaseModel], prefix: str) -> str:
    """Suggest a key of the same section with a similar name, or of any section with that name, or
    list the section's keys."""
    section, _, leaf = key.rpartition(".")
    keys = known_keys(model)
    siblings = [k for k in keys if k.rpartition(".")[0] == section]
    for candidates, cutoff in ((siblings, 0.6), (keys, 0.8)):
        leaves = {k.rpartition(".")[2]: k for k in candidates}
        close = [name for name in leaves if leaf and name.startswith(f"{leaf}_")]
        close = close or difflib.get_close_matches(leaf, leaves, n=1, cutoff=cutoff)
        if close:
            return f", did you mean '{prefix}{leaves[close[0]]}'?"
    return f"; allowed: {', '.join(prefix + name for name in siblings)}" if siblings else ""
