"""Section about the map matcher."""

from functools import partial
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from isogal import plugins
from isogal.scenario.section import Document, NonNegative, Positive, Section

MatcherName = Annotated[str, AfterValidator(partial(plugins.check, plugins.MATCHERS))]


class Matcher(Section):
    """The map matcher and what it assumes of map and readings."""

    name: MatcherName = Field("pmht", json_schema_extra={"plugins": plugins.MATCHERS})
    """matching algorithm"""
    batch_length: int = Field(30, ge=2, le=1000)
    """scans T in a batch"""
    stride: int | None = Field(None, ge=1, le=1000)
    """new scans between fixes; null = the matcher's own best (pmht: 5), else all"""
    mode: Literal["standard", "retrodiction"] = "standard"
    """one fix a batch, or one for each of its scans"""
    map_sigma: NonNegative | Literal["auto"] = "auto"
    """1-sigma of the map's error assumed, in the unit of gravimeter.sigma; auto = learnt"""
    map_correlation_length: Positive = 4000.0
    """its correlation length, m"""
    bias_sigma: NonNegative = 0.0
    """1-sigma of an unknown constant offset of the readings, in the unit of gravimeter.sigma"""
    options: Document = Field(default_factory=dict)
    """settings of the named matcher; see docs/matchers.md"""

    @model_validator(mode="after")
    def _stride_fits(self) -> "Matcher":
        if self.stride is not None and self.stride > self.batch_length:
            raise ValueError(
                f"stride ({self.stride}) must not exceed batch_length ({self.batch_length})"
            )
        return self

    @property
    def scans_between_fixes(self) -> int:
        """The stride; where it is null what the matcher says is its best (`stride` of its class),
        or the length of a batch.
        """
        if self.stride is not None:
            return self.stride
        best = plugins.says(plugins.MATCHERS, self.name, "stride", self.batch_length)
        return min(best, self.batch_length)

    @property
    def learns_map_error(self) -> bool:
        """Whether the map's error is not specified, and its fixes will say what it is."""
        learns = plugins.says(plugins.MATCHERS, self.name, "learns_map_error", False)
        return learns and self.map_sigma == "auto"
