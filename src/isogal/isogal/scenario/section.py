"""What the sections of a scenario share."""

from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field

LatitudeDeg = Annotated[float, Field(ge=-89.0, le=89.0)]
LongitudeDeg = Annotated[float, Field(ge=-180.0, le=360.0)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class Section(BaseModel):
    """A section: unknown keys are errors, values do not change, defaults are checked as well."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)

    errors: ClassVar[tuple[str, ...]] = ()
    """Keys, dotted where a section is inside, that are sizes of errors: `truth` may multiply them
    all at once."""

    def resolved(self) -> dict[str, Any]:
        """Return the section's values by key. A section that takes defaults from elsewhere puts
        them in place of its own null here, so that `truth` can multiply them."""
        return self.model_dump()
