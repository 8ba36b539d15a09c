"""What the page shows."""

from collections.abc import Sequence
from dataclasses import dataclass

from isogal.evaluation.records import Runs
from isogal.scenario import Assumed


@dataclass(frozen=True, slots=True)
class Event:
    """Something that a node said."""

    time: float
    """s, of the same clock as the run's."""
    level: str
    """WARN, ERROR or STALE."""
    source: str
    """Who said it."""
    text: str


@dataclass(frozen=True, slots=True)
class AidUse:
    """A time over which an aid was used, or was not for one reason."""

    aid: str
    """Its topic."""
    begin: float
    """s, of the same clock as the run's."""
    end: float
    used: bool
    text: str
    """What the navigator said of it."""


@dataclass(frozen=True, slots=True)
class ViewedRun:
    """One run, and what is said of it."""

    runs: Runs
    """Of one run."""
    assumed: Assumed
    title: str
    subtitle: str = ""
    events: Sequence[Event] | None = None
    """None = what the nodes said was not recorded."""
    is_true: bool = True
    """Whether the positions of `runs` are true; else they are the navigator's own, and errors
    are not known."""
    aids: Sequence[AidUse] = ()
    """When each aid was used; none where that was not recorded."""
    has_map: bool = True
    """Whether it is known what was matched against."""

    @property
    def missing(self) -> list[str]:
        """Sentences that say what the record does not hold."""
        detail, said = self.runs.detail, []
        if not self.is_true:
            said.append(
                "Where the vehicle truly was (ground_truth/fix) was not recorded, so errors are"
                " not known. Shown is where the navigator believed itself, and what it claimed."
            )
        if not self.has_map:
            said.append(
                "The recording does not say which scenario, thus which map, it is of (--scenario)."
            )
        if detail is None:
            said.append(
                "Readings and candidates were not recorded: a study keeps them of run 0 only."
            )
        elif detail.scan_time.size == 0:
            said.append("Readings were not recorded.")
        elif detail.candidate_batch.size == 0:
            said.append(
                f"Candidates were not recorded: the matcher {self.assumed.matcher.name} published"
                " none."
            )
        if self.events is None:
            said.append("What the nodes said (/diagnostics) was not recorded: a study has none.")
        said.append(
            "The matcher's posterior over the map is not recorded. Shown instead are its"
            " candidates, the fix with the covariance of the measurements alone, and the"
            " navigator's Gaussian posterior after it."
        )
        return said
