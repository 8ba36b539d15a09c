"""The cases that the paper's tables and figures need, as scenarios."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from isogal.errors import InputError
from isogal.fields.source_map import source_map
from isogal.maps.corridor import corridor_of
from isogal.maps.field_map import FieldMap
from isogal.maps.load import check_coverage
from isogal.montecarlo.chunks import Case
from isogal.paper.published import GAIN_TIME, LOW, ROWS
from isogal.scenario import Scenario, validate_scenario
from isogal.scenario.imu_grades import PAPER_GRADES
from isogal.sensors.trajectory import build_trajectory

PAPER, DEFAULT = "pmht-paper", "pmht"
MATCHERS = (PAPER, DEFAULT)
SWEEP_HEADINGS = (1e-4, 3e-4, 1e-3)
"""rad, 1-sigma of the initial heading error."""
SWEEP_SPEEDS = (11.0, 22.0, 33.0, 45.0)
"""m/s; at 45.9 m/s the whole route takes 3.6 h."""
SWEEP_SHARE = 5
"""The sweeps have a fifth of the runs."""
RIVAL = "tercom"
"""Area correlation, with which the paper compares its matcher in words."""


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
    speed: float = 22.0
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
        parts += [f"{self.speed:g} m/s"] if self.speed != default.speed else []
        return ", ".join(parts)


def table_settings() -> list[Setting]:
    """Return the rows of Tables 4 and 6 for both matchers."""
    return [
        Setting(row.quantity, row.sigma, row.batch_length, matcher)
        for matcher in MATCHERS[::-1]
        for row in ROWS
    ]


def unaided_settings() -> list[Setting]:
    """Return the unaided navigator of each grade."""
    return [Setting(grade=grade, aided=False) for grade in PAPER_GRADES]


def retrodiction_settings() -> list[Setting]:
    """Return the paper's second way of aiding; the first is in the tables."""
    return [Setting(batch_length=length, mode="retrodiction") for length in (30, 15)]


def sweep_settings(matcher: str) -> list[Setting]:
    """Return the settings for the sensitivity to heading error and speed."""
    headings = [Setting(matcher=matcher, heading=heading) for heading in SWEEP_HEADINGS]
    return headings + [
        Setting(matcher=matcher, speed=speed) for speed in SWEEP_SPEEDS if speed != Setting().speed
    ]


def rival_setting() -> Setting:
    """Return area correlation in the paper's best case."""
    return Setting(matcher=RIVAL)


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """All cases by setting, on one source of maps.

    Parameters
    ----------
    runs : int
        Of each case of the tables; the sweeps have fewer.
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
        document: dict[str, Any] = {
            "route": {"speed": setting.speed, "duration": self.duration},
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

    def field_map(self, setting: Setting) -> FieldMap:
        """Return the map of a setting, cut to its route; raises InputError."""
        return _map(self.scenario(Setting(quantity=setting.quantity, speed=setting.speed)))

    def case(self, setting: Setting) -> Case:
        """Return the case of a setting."""
        swept = (
            setting in [*sweep_settings(PAPER), *sweep_settings(DEFAULT)]
            and setting not in table_settings()
        )
        few = swept or setting.matcher == RIVAL
        runs = max(1, self.runs // SWEEP_SHARE) if few else self.runs
        return Case(
            setting.name, self.scenario(setting), runs, self.field_map(setting), setting.aided
        )

    def settings(self) -> list[Setting]:
        """Return all settings, those that take longest first, each once."""
        wanted = [
            *table_settings(),
            *retrodiction_settings(),
            *sweep_settings(DEFAULT),
            *sweep_settings(PAPER),
            rival_setting(),
            *unaided_settings(),
        ]
        return list(dict.fromkeys(wanted))


@lru_cache(maxsize=8)
def _map_of(source: str, quantity: str, speed: float, duration: float) -> FieldMap:
    scenario = validate_scenario(
        {
            "route": {"speed": speed, "duration": duration},
            "gravimeter": {"quantity": quantity},
            "map": {"source": source, "continuation": "none"},
        }
    )
    trajectory = build_trajectory(scenario)
    route = trajectory.latitude, trajectory.longitude
    try:
        field_map = source_map(scenario, corridor_of(*route).window)
        check_coverage(field_map, *route)
        return field_map
    except InputError as error:
        raise InputError(f"--map: {error}" if source != "synthetic" else str(error)) from None


def _map(scenario: Scenario) -> FieldMap:
    assert scenario.route.duration is not None
    return _map_of(
        scenario.map.source,
        scenario.gravimeter.quantity,
        scenario.route.speed,
        scenario.route.duration,
    )
