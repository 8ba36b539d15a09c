"""Section about the filter that fuses inertial data with fixes."""

from typing import Literal

from pydantic import Field

from isogal.scenario.section import Section


class Fusion(Section):
    """The navigator's filter."""

    filter: Literal["compiled", "reference"] = Field(
        "compiled",
        description="which unscented filter: Isogal's, or filterpy's to compare it with (slow)",
    )
