"""The cases that the paper's tables and figures need, as scenarios."""

from dataclasses import dataclass
from functools import lru_cache

from isogal.errors import InputError
from isogal.fields.source_map import MapSource
from isogal.maps.corridor import corridor_of
from isogal.maps.field_map import FieldMap
from isogal.maps.load import check_coverage
from isogal.montecarlo.cases import Case
from isogal.paper.published import GAIN_TIME, LOW, ROWS
from isogal.scenario import Scenario, validate_scenario
from isogal.scenario.inertial import PAPER_GRADES
from isogal.scenario.section import Document
from isogal.sensors.trajectory import Trajectory, build_trajectory

PAPER, DEFAULT = "pmht-paper", "pmht"
MATCHERS = (PAPER, DEFAULT)


@dataclass(frozen=True, slots=True)
class Setting:
    """Where a case departs from the default scenario."""

    quantity: str = "gravity"
    sigma: float = LOW["gravity"]
    batch_length: int = 30
    matcher: str = PAPER
    mode: str = "standard"
    grade: str = "precision"
    heading: float = 3e-4
    aided: bool = True

    @property
    def name(self) -> str:
        """One line for messages."""
        if not self.aided:
            return f"unaided, {self.grade.replace('_', ' ')}"
        parts = [self.matcher, self.quantity, f"sigma {self.sigma:g}", f"T = {self.batch_length}"]
        default = Setting()
        parts += [self.mode] if self.mode != default.mode else []
        parts += [f"heading error {self.heading:g} rad"] if self.heading != default.heading else []
        return ", ".join(parts)


TABLES = [
    Setting(row.quantity, row.sigma, row.batch_length, matcher)
    for matcher in reversed(MATCHERS)
    for row in ROWS
]
"""The rows of Tables 4 and 6 for both matchers."""
AIDING = [
    Setting(batch_length=length, mode=mode)
    for length in (30, 15)
    for mode in ("standard", "retrodiction")
]
"""The paper's two ways of aiding."""
UNAIDED = [Setting(grade=grade, aided=False) for grade in PAPER_GRADES]
HEADINGS = (1e-4, 3e-4, 1e-3)
"""rad, 1-sigma of the initial heading error."""
RIVAL = Setting(matcher="tercom")
"""Area correlation, with which the paper compares its matcher in words, in its best case."""

SETTINGS = tuple(dict.fromkeys([*TABLES, *AIDING, *UNAIDED, RIVAL]))
"""Of all cases, each once; the rival has a fifth of the runs."""


@dataclass(frozen=True)
class Plan:
    """All cases by setting, on one source of maps.

    Parameters
    ----------
    runs : int
        Of each case but that of `RIVAL`, which has fewer.
    map_path : str or None
        File or folder with gravity and disturbance; None = the synthetic map.
    duration : float
        s, simulated time of each run.
    """

    runs: int
    map_path: str | None
    duration: float

    @property
    def gain_time(self) -> float:
        """When the grades are compared, s: as in the paper, or at the end of shorter runs."""
        return min(GAIN_TIME, self.duration)

    def scenario(self, setting: Setting) -> Scenario:
        """Return the scenario of a setting."""
        document: Document = {
            "route": {"duration": self.duration},
            "imu": {"grade": setting.grade},
            "initial_error": {"heading": setting.heading},
            "gravimeter": {"quantity": setting.quantity, "sigma": setting.sigma},
            # in the paper the map holds where the vehicle goes
            "map": {"source": self.map_path or "synthetic", "continuation": "none"},
            "gravity": {"field": "normal"},  # which the paper's vehicle feels
            "fusion": {"false_rejection": 0.0},  # the paper's filter takes every fix
            "matcher": {
                "name": setting.matcher,
                "batch_length": setting.batch_length,
                "mode": setting.mode,
                # batches do not overlap, and the map is exact
                "stride": setting.batch_length,
                "map_sigma": 0.0,
            },
        }
        return validate_scenario(document)

    def trajectory(self, setting: Setting) -> Trajectory:
        """Return the true track of a setting."""
        return build_trajectory(self.scenario(setting))

    def field_map(self, setting: Setting) -> FieldMap:
        """Return the map of a setting, cut to its route; raises InputError."""
        return _map_along(self, Setting(quantity=setting.quantity))

    def case(self, setting: Setting) -> Case:
        """Return the case of a setting; raises InputError where the map cannot be used."""
        runs = max(1, self.runs // 5) if setting == RIVAL else self.runs
        scenario, field_map = self.scenario(setting), self.field_map(setting)
        return Case(setting.name, scenario, runs, field_map, setting.aided)


@lru_cache(maxsize=8)
def _map_along(plan: Plan, setting: Setting) -> FieldMap:
    trajectory = plan.trajectory(setting)
    route = trajectory.latitude, trajectory.longitude
    try:
        field_map = MapSource.of(plan.scenario(setting))(window=corridor_of(*route).window)
        check_coverage(field_map, *route)
        return field_map
    except InputError as error:
        raise InputError(f"--map: {error}" if plan.map_path else str(error)) from None
