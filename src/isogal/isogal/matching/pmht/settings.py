"""Options of `pmht`: what a user may want to change."""

from dataclasses import dataclass, field

from pydantic import BaseModel, ConfigDict, Field

from isogal.matching.pmht.noise_model import NoiseModel
from isogal.matching.registry import check_options
from isogal.scenario import Matcher as MatcherSettings


class Options(BaseModel):
    """`matcher.options` of a scenario."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    context: int | None = Field(
        None,
        ge=0,
        description="older scans whose residuals predict the map error; null = batch_length",
    )
    samples: int = Field(512, ge=64, le=65536, description="points per round of the sampler")
    hypotheses: int = Field(2048, ge=1, le=10000, description="hypotheses kept at most")
    confidence: float = Field(
        0.999,
        gt=0.5,
        lt=1.0,
        description="probability a hypothesis needs before it is published",
    )
    outlier_gate: float = Field(
        4.5, gt=0.0, description="1-sigma beyond which a reading is left out"
    )
    significance: float = Field(
        1e-4, gt=0.0, lt=0.5, description="p-value under which a batch counts as inconsistent"
    )
    tolerance: float = Field(
        2.0,
        ge=1.0,
        description="misfit per degree of freedom that is never called inconsistent",
    )
    largest_misfit: float = Field(
        9.0, gt=1.0, description="misfit per degree of freedom above which no fix is published"
    )
    bias_drift_sigma: float | None = Field(
        None,
        ge=0.0,
        description=(
            "1-sigma of the readings' drift, map's unit per second; null = bias_sigma in three"
            " hours"
        ),
    )
    trust: float = Field(
        2.0,
        ge=1.0,
        le=100.0,
        description=(
            "factor within which a given map_sigma and correlation length are right (1-sigma); 1"
            " = to the letter"
        ),
    )


@dataclass(frozen=True)
class Settings:
    """What the matcher is told: options, and what it assumes about the map and the sensor."""

    noise: NoiseModel
    adaptive: bool = False
    """Whether the map error is learnt from nothing (`map_sigma: auto`)."""
    options: Options = field(default_factory=Options)
    context: int = 30
    """Older scans that a batch brings along."""
    each_scan: bool = False
    """Whether fixes say what each scan is given of them (retrodiction)."""

    @classmethod
    def of(cls, matcher: MatcherSettings) -> "Settings":
        """Read a scenario's matcher section; raises InputError on an unknown or bad option."""
        options: Options = check_options("pmht", matcher.options, Options)
        adaptive = matcher.map_sigma == "auto"
        noise = NoiseModel(
            map_sigma=0.0 if adaptive else float(matcher.map_sigma),
            correlation_length=matcher.map_correlation_length,
            bias_sigma=matcher.bias_sigma,
        )
        context = matcher.batch_length if options.context is None else options.context
        return cls(noise, adaptive, options, context, matcher.mode == "retrodiction")
