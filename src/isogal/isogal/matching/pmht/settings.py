"""Options of `pmht`, and what it assumes of map and instrument."""

import math

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.maps.channels import AnyMap, channels_of
from isogal.maps.quantities import GRAVITY
from isogal.maps.roughness import roughness
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.hypotheses import CURVED
from isogal.matching.pmht.models import DRIFT_TIME, Assumed
from isogal.matching.pmht.rows import stated_sigma
from isogal.matching.registry import check_options
from isogal.scenario import Matcher as MatcherSettings


class Options(BaseModel):
    """`matcher.options` of a scenario."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    trust: float = Field(
        2.0,
        ge=1.0,
        le=100.0,
        description=(
            "factor within which a given map_sigma and correlation length are right (1-sigma); 1"
            " = to the letter"
        ),
    )
    curved: float = Field(
        CURVED,
        gt=0.0,
        le=1.0,
        description=(
            "share of its change by which the map may depart from linear over a hypothesis before"
            " that is split; less where a navigator is far less certain than the map's hills are"
            " wide, at the price of time"
        ),
    )
    bias_drift_sigma: float | None = Field(
        None,
        ge=0.0,
        description=(
            "1-sigma of the readings' drift, map's unit per second; null = bias_sigma in three"
            " hours"
        ),
    )


def options_of(matcher: MatcherSettings) -> Options:
    """Return its options; raises InputError on an unknown or bad one."""
    return check_options("pmht", matcher.options, Options)


def assumed(matcher: MatcherSettings, batch: Batch, field_map: AnyMap) -> Assumed:
    """Return what is known before the first batch of a run, by a scenario's matcher section;
    raises InputError on a bad option."""
    options, maps = options_of(matcher), channels_of(field_map)
    rounding = float(np.mean([one.quantisation for one in maps])) / math.sqrt(12.0)
    stated = float(np.mean([stated_sigma(one) for one in maps]))
    specified = None if matcher.map_sigma == "auto" else float(matcher.map_sigma)
    if stated > 0.0:
        specified = max(specified or 0.0, stated)
    drift = options.bias_drift_sigma
    named = () if batch.parameters is None else batch.parameters.names
    return Assumed(
        noise=math.hypot(float(np.nanmedian(batch.sigma)), rounding),
        scale=float(np.mean([one.scale for one in maps])),
        rough=float(np.mean([roughness(one) for one in maps])),
        step=math.hypot(*maps[0].cell_size_m(float(batch.latitude[-1]))) / math.sqrt(2.0),
        sigma=specified,
        length=matcher.map_correlation_length,
        trust=options.trust,
        bias=matcher.bias_sigma,
        drift=matcher.bias_sigma / DRIFT_TIME if drift is None else drift,
        walks=batch.bias_walk > 0.0,
        delay=batch.delay_sigma,
        filtered=batch.filter_path is not None,
        satellites=batch.satellites,
        shaken=field_map.quantity in GRAVITY and "coupling_forward" not in named,
    )
