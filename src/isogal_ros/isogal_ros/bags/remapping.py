"""Topics of a recording that have other names than the graph's."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field

from pydantic import JsonValue

from isogal.errors import InputError, nearest
from isogal.yaml_text import parse_yaml
from isogal_ros import topics

_PLAIN = "FROM:=TO, a driver's topic and the graph's, as in /sbg/imu:=imu/data_raw"


@dataclass
class Remapping:
    """Which recorded topics stand for which of the graph's; one of the graph's own name is left
    out where another stands for it, so that one of several sources is chosen."""

    names: dict[str, str] = field(default_factory=dict)
    """Of the graph, absolute, by recorded one."""
    _seen: set[str] = field(default_factory=set)

    @classmethod
    def parse(cls, rules: Sequence[str], option: str = "--remap") -> "Remapping":
        """Return what rules FROM:=TO say, which an option gives.

        Raises
        ------
        InputError
            One is none, TO is no topic of the graph, or one of them comes twice.
        """
        names: dict[str, str] = {}
        for rule in rules:
            recorded, sign, name = (part.strip() for part in rule.partition(":="))
            name = name.lstrip("/")
            if not (sign and recorded.strip("/") and name):
                raise InputError(f"{option} {rule}: must be {_PLAIN}")
            topics.topic_named(name, topics.ALL, f"{option} {rule}")
            recorded = "/" + recorded.lstrip("/")
            if recorded in names or f"/{name}" in names.values():
                raise InputError(f"{option} {rule}: one of the two topics comes twice")
            names[recorded] = f"/{name}"
        return cls(names)

    def __call__(self, recorded: str) -> str | None:
        """Return the name that stands for a recorded topic; None = it is left out."""
        self._seen.add(recorded)
        if recorded in self.names:
            return self.names[recorded]
        taken = any(recorded.endswith(name) for name in self.names.values())
        return None if taken else recorded

    def check(self, where: object) -> None:
        """Raise InputError where a topic that is renamed has not been seen in a recording."""
        for name in self.names.keys() - self._seen:
            hint = nearest(name, self._seen, 0.4) or f"; it has {', '.join(self._seen)}"
            raise InputError(f"{where}: --remap: no topic {name!r} in the recording{hint}")


def given_drivers(texts: Sequence[str]) -> dict[str, dict[str, JsonValue]]:
    """Return entries of `drivers` from ``TOPIC.KEY=VALUE``, values in YAML; raises InputError
    where a text has another form."""
    found: defaultdict[str, dict[str, JsonValue]] = defaultdict(dict)
    for text in texts:
        name, equals, value = text.partition("=")
        topic, dot, key = name.rpartition(".")
        if not (equals and dot and topic and key):
            raise InputError(
                f"--driver {text}: must be TOPIC.KEY=VALUE, as in gravimeter/data_raw.unit=mGal"
            )
        found[topic.lstrip("/")][key] = parse_yaml(value, f"--driver {name}") if value else ""
    return dict(found)
