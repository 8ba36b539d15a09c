"""Matchers by name, found by `isogal.plugins`, built from a scenario's section ``matcher``."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel

from isogal import plugins
from isogal.errors import InputError
from isogal.fields.measured import field_named
from isogal.matching.interfaces import Matcher
from isogal.scenario import Assumed, validated
from isogal.scenario import Matcher as MatcherSettings

Options = TypeVar("Options", bound=BaseModel)
_MEMBERS = ("from_settings", "name", "context", "takes_channels", "match")


def time_between_fixes(assumed: Assumed) -> float:
    """Return the time between the fixes of a field if it were alone, s."""
    return assumed.matcher.scans_between_fixes * assumed.gravimeter.interval


def leading_field(each: Sequence[Assumed]) -> int:
    """Return which of the fields of a scenario (`Assumed.each_field`) says when batches end, for
    all of them: that with the least time between its fixes."""
    times = [time_between_fixes(one) for one in each]
    return times.index(min(times))


def build_run_matcher(assumed: Assumed) -> Matcher:
    """Return the matcher of one field, or of several.

    Raises
    ------
    InputError
        See `load_matcher` and `matcher_of_fields`.
    """
    each = assumed.each_field
    channels = [field_named(one.measured_field).channels is not None for one in each]
    if len(each) == 1:
        return load_matcher(each[0].matcher, channels[0])
    settings = [one.matcher for one in each]
    return matcher_of_fields(settings, assumed.field_names, leading_field(each))


def matcher_of_fields(
    settings: Sequence[MatcherSettings], names: Sequence[str], lead: int
) -> Matcher:
    """Return the matcher of several fields together, `lead` the one whose batch ends are
    everybody's; raises InputError where a matcher matches one field only."""
    for one in settings:
        require(one.name, "of_fields", "fields")
    kind = plugins.load(plugins.MATCHERS, settings[lead].name)
    return kind.of_fields(settings, names, lead)


def load_matcher(settings: MatcherSettings, channels: bool = False) -> Matcher:
    """Return the matcher that the scenario names, by itself.

    Parameters
    ----------
    settings : scenario.Matcher
    channels : bool
        Whether it is to match readings of several channels.

    Raises
    ------
    InputError
        The name is unknown, an option is unknown or out of range, the matcher does not take
        several channels, or what a package gives is none.
    """
    if channels and not able(settings.name, "takes_channels"):
        others = [one for one in plugins.names(plugins.MATCHERS) if able(one, "takes_channels")]
        raise InputError(
            f"matcher.name: {settings.name} takes one number per scan; for readings of several"
            f" channels give {' or '.join(others)}"
        )
    found = plugins.load(plugins.MATCHERS, settings.name)
    matcher: Matcher = getattr(found, "from_settings", lambda _: found)(settings)
    if lacking := [one for one in _MEMBERS if not hasattr(matcher, one)]:
        raise InputError(
            f"matcher '{settings.name}': its package gives no {Matcher.__module__}.Matcher: it"
            f" lacks {', '.join(lacking)}"
        )
    return matcher


def require(name: str, ability: str, key: str) -> None:
    """Raise InputError where a matcher does not have what a key of a scenario asks for: an
    attribute of its class, as `takes_parameters`."""
    if not able(name, ability):
        others = [one for one in plugins.names(plugins.MATCHERS) if able(one, ability)]
        raise InputError(f"{key}: matcher {name} does not have it; give {' or '.join(others)}")


def able(name: str, ability: str) -> bool:
    """Return whether a matcher has an ability: an attribute of its class."""
    return plugins.says(plugins.MATCHERS, name, ability, False)


def check_options(matcher: str, options: Mapping[str, Any], model: type[Options]) -> Options:
    """Validate ``matcher.options`` against the pydantic model of one matcher; raises InputError
    with one line.
    """
    return validated(model, options, where=f"matcher.options of {matcher}: ")
