"""What the sections of a scenario share."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

LatitudeDeg = Annotated[float, Field(ge=-89.0, le=89.0)]
LongitudeDeg = Annotated[float, Field(ge=-180.0, le=360.0)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class Section(BaseModel):
    """A section: unknown keys are errors, values do not change, defaults are checked as well."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)
