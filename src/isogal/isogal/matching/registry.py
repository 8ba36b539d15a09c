"""Matchers by name, found by `isogal.plugins`, built from a scenario's section ``matcher``."""

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ValidationError

from isogal import plugins
from isogal.errors import InputError
from isogal.fields.measured import field_named
from isogal.matching.interfaces import Matcher
from isogal.matching.monitoring import Monitor, Monitored
from isogal.matching.several import JointMatcher, Rhythm
from isogal.scenario import Matcher as MatcherSettings
from isogal.scenario import Scenario, describe


def build_matcher(settings: MatcherSettings, channels: bool = False) -> Matcher:
    """Return the matcher that the scenario names, watched for a navigator that is lost where the
    matcher can be watched (`monitoring.Monitored`).

    Parameters and errors as for `load_matcher`.
    """
    matcher = load_matcher(settings, channels)
    if not isinstance(matcher, Monitored):
        return matcher
    return _watched(matcher, settings.map_sigma == 0.0)


def _watched(matcher: Monitored, exact: bool) -> Matcher:
    """Return a matcher with its monitors; `exact`: the map is said to have no error."""
    from isogal.matching.pmht.assumptions_monitor import AssumptionsMonitor
    from isogal.matching.pmht.lost_navigator import LostNavigatorMonitor

    watched = LostNavigatorMonitor(matcher)
    # who says that the map is exact leaves what else may be wrong no way to show
    return watched if exact else AssumptionsMonitor(watched)


def build_run_matcher(scenario: Scenario) -> Matcher:
    """Return the matcher of a scenario's field, or of its several fields as one
    (`several.JointMatcher`), watched as one.

    Raises
    ------
    InputError
        See `load_matcher`.
    """
    each = scenario.each_field
    channels = [field_named(one.measured_field).channels is not None for one in each]
    if len(each) == 1:
        return build_matcher(each[0].matcher, channels[0])
    matchers = tuple(
        load_matcher(one.matcher, several) for one, several in zip(each, channels, strict=True)
    )
    joint = JointMatcher(matchers, scenario.field_names, Rhythm.of(each).lead)
    exact = any(one.matcher.map_sigma == 0.0 for one in each)
    return _watched(joint, exact) if isinstance(joint.first, Monitored) else joint


def contexts_of(matcher: Matcher, fields: int) -> tuple[int, ...]:
    """Return how many older scans a matcher wants of each field."""
    inner: Any = matcher
    while isinstance(inner, Monitor):
        inner = inner.matcher
    if isinstance(inner, JointMatcher):
        return tuple(one.context for one in inner.matchers)
    return (matcher.context,) * fields


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
        The name is unknown, an option is unknown or out of range, or the matcher does not take
        several channels.
    """
    if channels and not able(settings.name, "takes_channels"):
        others = [one for one in plugins.names(plugins.MATCHERS) if able(one, "takes_channels")]
        raise InputError(
            f"matcher.name: {settings.name} takes one number per scan; for readings of several"
            f" channels give {' or '.join(others)}"
        )
    matcher: Matcher = plugins.load(plugins.MATCHERS, settings.name).from_settings(settings)
    return matcher


def require(name: str, ability: str, key: str) -> None:
    """Raise InputError where a matcher does not have what a key of a scenario asks for: an
    attribute of its class, as `takes_parameters`."""
    if not able(name, ability):
        others = [one for one in plugins.names(plugins.MATCHERS) if able(one, ability)]
        raise InputError(f"{key}: matcher {name} does not have it; give {' or '.join(others)}")


def able(name: str, ability: str) -> bool:
    """Return whether a matcher has an ability: an attribute of its class."""
    return bool(getattr(plugins.load(plugins.MATCHERS, name), ability, False))


def check_options(matcher: str, options: Mapping[str, Any], model: type[BaseModel]) -> Any:
    """Validate ``matcher.options`` against the pydantic model of one matcher; raises InputError
    with one line.
    """
    try:
        return model(**options)
    except ValidationError as error:
        raise InputError(f"matcher.options of {matcher}: {describe(error, model)}") from None
