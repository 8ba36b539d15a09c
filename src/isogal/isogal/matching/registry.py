"""Matchers by name: adding one is one file and one line here."""

import difflib
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from isogal.errors import InputError
from isogal.matching.interfaces import Matcher
from isogal.scenario import Matcher as MatcherSettings

# name -> "module:factory"; the factory takes the scenario's matcher section and gives a Matcher.
MATCHERS: dict[str, str] = {
    "pmht-paper": "isogal.matching.paper.matcher:PmhtPaper.from_settings",
    "pmht": "isogal.matching.pmht.lost_navigator:Doubting.from_settings",
    "tercom": "isogal.matching.baselines.tercom:Tercom.from_settings",
    "iccp": "isogal.matching.baselines.iccp:Iccp.from_settings",
    "sitan": "isogal.matching.baselines.sitan:Sitan.from_settings",
    "particle": "isogal.matching.baselines.particle:Particle.from_settings",
    "point-mass": "isogal.matching.baselines.point_mass:PointMass.from_settings",
    "viterbi": "isogal.matching.baselines.viterbi:Viterbi.from_settings",
}

SEVERAL_CHANNELS = ("pmht",)
"""Those that take readings of several channels."""


def build_matcher(settings: MatcherSettings, channels: bool = False) -> Matcher:
    """Return the matcher that the scenario names.

    Parameters
    ----------
    settings : scenario.Matcher
    channels : bool
        Whether it is to match readings of several channels.

    Raises
    ------
    InputError
        The name is unknown, an option is unknown or out of range, or it does not take several
        channels.
    """
    try:
        target = MATCHERS[settings.name]
    except KeyError:
        close = difflib.get_close_matches(settings.name, MATCHERS, n=1)
        hint = f", did you mean '{close[0]}'?" if close else f"; allowed: {', '.join(MATCHERS)}"
        raise InputError(f"matcher.name: unknown matcher '{settings.name}'{hint}") from None
    if channels and settings.name not in SEVERAL_CHANNELS:
        raise InputError(
            f"matcher.name: {settings.name} takes one number per scan; for readings of several channels give"
            f" {' or '.join(SEVERAL_CHANNELS)}"
        )
    if channels and settings.map_sigma == "auto":
        raise InputError(
            "matcher.map_sigma: auto is for scalar fields; for readings of several channels give a number, 1/s²"
            " where field is gradient"
        )
    module_name, _, path = target.partition(":")
    factory: Any = import_module(module_name)
    for part in path.split("."):
        factory = getattr(factory, part)
    build: Callable[[MatcherSettings], Matcher] = factory
    return build(settings)


def check_options(matcher: str, options: Mapping[str, Any], model: type) -> Any:
    """Validate ``matcher.options`` against the pydantic model of one matcher; raises InputError
    with one line."""
    from pydantic import ValidationError

    from isogal.scenario import describe

    try:
        return model(**options)
    except ValidationError as error:
        raise InputError(f"matcher.options of {matcher}: {describe(error)}") from None
