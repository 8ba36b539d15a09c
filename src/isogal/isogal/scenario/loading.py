"""Scenarios from YAML files, with single keys overridden."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from isogal import plugins
from isogal.errors import InputError
from isogal.files import reading
from isogal.scenario.model import Scenario
from isogal.scenario.section import Document, Value, validated
from isogal.yaml_text import parse_yaml


def load_scenario(path: str | Path | None = None, overrides: str | Iterable[str] = ()) -> Scenario:
    """Read a scenario file (null = all defaults), apply ``KEY=VALUE`` overrides (YAML values,
    dotted keys; one or several), validate.

    Raises
    ------
    InputError
        One line that names the file and key and what is allowed.
    """
    where = "scenario" if path is None else str(path)
    document: Document = {}
    if path is not None:
        with reading(path):
            text = Path(path).read_text(encoding="utf-8")
        document = parse_yaml(text, where) or {}
        if not isinstance(document, dict):
            raise InputError(f"{where}: must be a mapping of keys, is a {type(document).__name__}")
    for item in [overrides] if isinstance(overrides, str) else overrides:
        _override(document, item)
    scenario = validate_scenario(document, where)
    _check_options(scenario, where)
    return scenario


def changed_scenario(scenario: Scenario, overrides: Iterable[str], where: str) -> Scenario:
    """Return a scenario with ``KEY=VALUE`` overrides; raises InputError with one line that begins
    with `where`."""
    document = scenario.model_dump(mode="json")
    for item in overrides:
        _override(document, item)
    return validate_scenario(document, where)


def validate_scenario(document: Mapping[str, Value], where: str = "scenario") -> Scenario:
    """Validate an already parsed document; raises InputError with one line.

    YAML 1.1 reads 1e-5 (no dot) as a string; pydantic turns it into the number that is meant,
    where a number belongs."""
    return validated(Scenario, document, where=f"{where}: ")


def _check_options(scenario: Scenario, where: str) -> None:
    """Have each matcher check its options, where some are given: its code is loaded for that.
    Those of a recording are checked where its matcher is built."""
    for one in scenario.each_field:
        if one.matcher.options:
            try:
                plugins.load(plugins.MATCHERS, one.matcher.name).from_settings(one.matcher)
            except InputError as error:
                raise InputError(f"{where}: {error}") from None


def _override(document: Document, item: str) -> None:
    key, equals, text = item.partition("=")
    if not equals or not key:
        raise InputError(
            f"--set {item}: must be KEY=VALUE, for example --set matcher.batch_length=15"
        )
    try:
        value = parse_yaml(text, key)
    except InputError:
        raise InputError(f"--set {item}: the value is not valid YAML") from None
    target = document
    *parents, last = key.split(".")
    for parent in parents:
        target = target.setdefault(parent, {})
        if not isinstance(target, dict):
            raise InputError(f"--set {item}: '{parent}' is a value, not a section")
    target[last] = value
