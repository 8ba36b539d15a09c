"""What the baseline matchers have in common as classes: settings in, readings prepared, nothing
carried from batch to batch."""

from typing import ClassVar, Generic, Self, TypeVar

from pydantic import BaseModel

from isogal.maps.channels import AnyMap, channels_of
from isogal.maps.field_map import FieldMap
from isogal.matching.baselines.readings import UsableReadings
from isogal.matching.interfaces import Batch, Fix, declined
from isogal.matching.registry import check_options
from isogal.matching.usability import too_few, unusable
from isogal.scenario import Matcher as MatcherSettings

Options = TypeVar("Options", bound=BaseModel)
Memory = TypeVar("Memory")


class Baseline(Generic[Options]):
    """A matcher of single batches (see `interfaces.Matcher`); a subclass says how readings become
    a fix."""

    name: ClassVar[str]
    options_model: type[Options]
    context: ClassVar[int] = 0
    takes_channels: ClassVar[bool] = False
    whole: ClassVar[bool] = False
    """Whether it takes the whole batch each time; False = only readings that no earlier batch has
    used."""

    def __init__(self, settings: MatcherSettings | None = None) -> None:
        """Take the scenario's section `matcher`; raises InputError on unknown or impossible
        options."""
        settings = settings or MatcherSettings()
        self.options: Options = check_options(self.name, settings.options, self.options_model)
        # `auto` is what the map states itself
        self.map_sigma = 0.0 if settings.map_sigma == "auto" else float(settings.map_sigma)
        """White 1-sigma of the map's error, map's unit."""
        self.bias_sigma = settings.bias_sigma
        """1-sigma of an unknown constant in the readings of a batch."""

    @classmethod
    def from_settings(cls, settings: MatcherSettings) -> Self:
        """Build it from the scenario; see the class."""
        return cls(settings)

    @property
    def fewest(self) -> int:
        """Readings that a fix needs."""
        return getattr(self.options, "min_scans", 1)

    def match(self, batch: Batch, field_map: AnyMap, memory: Memory) -> tuple[Fix, Memory]:
        """Match one batch (see `interfaces.Matcher`)."""
        if reason := unusable(batch):
            return declined(batch, reason), memory
        one = channels_of(field_map)[0]
        readings = UsableReadings.of(batch, one, self.map_sigma, self.whole)
        if reason := too_few(batch, len(readings), self.fewest):
            return declined(batch, reason), memory
        return self.solve(batch, one, readings), memory

    def solve(self, batch: Batch, field_map: FieldMap, readings: UsableReadings) -> Fix:
        """Return the fix of a batch from its usable readings."""
        raise NotImplementedError
