"""What the matcher of ``isogal match`` is told: options, the map, and what the track leaves
open."""

import math
from typing import TYPE_CHECKING

from isogal.cli.errors import note
from isogal.cli.match.inputs import Inputs
from isogal.cli.match.options import Assumptions, MatcherChoice

if TYPE_CHECKING:
    from isogal.scenario import Matcher

_LENGTH = "matcher.map_correlation_length"


def matcher_settings(
    matching: MatcherChoice, assumed: Assumptions, inputs: Inputs, reduction: str | None
) -> "Matcher":
    """Return the scenario's section `matcher`; say on the standard error stream what is assumed
    that nobody has said.

    Sigmas of the options are in the track's unit, those of ``--set`` in the unit inside.

    Raises
    ------
    InputError
        A key or a value is not allowed.
    """
    from isogal.scenario import load_scenario

    field_map = inputs.scalar_map
    changes = matching.changes() + assumed.map_changes(field_map, inputs.factor)
    said = {item.partition("=")[0] for item in changes}
    if _LENGTH not in said and field_map.correlation_length is not None:
        changes.append(f"{_LENGTH}={field_map.correlation_length!r}")
    settings = load_scenario(None, changes).matcher
    if "matcher.map_sigma" not in said and not field_map.states_error:
        note(
            "the map does not say how wrong it is, which is estimated along the track; give"
            " --map-sigma where it is known"
        )
    if matching.whole:
        length = max(len(inputs.track), 2)
        settings = settings.model_copy(update={"batch_length": length, "stride": None})
    if reduction is None:
        settings = _with_unknown_latitude(settings, inputs, assumed.prior_sigma)
    return settings


def _with_unknown_latitude(settings: "Matcher", inputs: Inputs, prior_sigma: float) -> "Matcher":
    """Return settings with an unknown constant, where the offset holds normal gravity and nobody
    has said at which latitude."""
    track = inputs.track
    change = track.normal_gravity_in_doubt(inputs.field_map.quantity) * prior_sigma
    if change == 0.0:
        return settings
    note(
        f"{track.where}: offset holds normal gravity; as it does not say at which latitude, an"
        f" unknown constant of {change / inputs.factor:.2g} {inputs.unit} is allowed for. Say"
        " --reduction latitude if it was the track's own, else --reduction none"
    )
    return settings.model_copy(update={"bias_sigma": math.hypot(settings.bias_sigma, change)})
