"""All that was measured, in one place for tables, figures and claims."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.fields.simulator import scan_index
from isogal.maps.variability import feature_variability, normalised_variability
from isogal.paper.cases import PAPER, Plan, Setting
from isogal.paper.iterations import Snapshot
from isogal.paper.lookups import ProfileExample, WindowExample
from isogal.paper.measure import Outcome, Spread, Tracks
from isogal.paper.published import PublishedRow
from isogal.sensors.trajectory import build_trajectory


@dataclass(frozen=True, slots=True, eq=False)
class AlongTrack:
    """What a noiseless sensor reads at the scans, and how much the map varies there (paper
    fig-60)."""

    time: Array
    """(S,) s."""
    signal: Array
    """(S,) map's unit."""
    variability: Array
    """(S,) eq. CV, map's unit squared."""
    normalised: Array
    """(S,) over the mean of the last samples."""


def along_track(plan: Plan, quantity: str) -> AlongTrack:
    """Read the map along the true track."""
    setting = Setting(quantity=quantity)
    scenario, field_map = plan.scenario(setting), plan.field_map(setting)
    trajectory = build_trajectory(scenario)
    scans = scan_index(scenario, trajectory)
    latitude, longitude = trajectory.latitude[scans], trajectory.longitude[scans]
    variability = feature_variability(field_map, latitude, longitude)
    return AlongTrack(
        trajectory.time[scans],
        field_map.value(latitude, longitude),
        variability,
        normalised_variability(variability),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """Outcomes by setting, and other measurements."""

    plan: Plan
    outcomes: Mapping[Setting, Outcome]
    spreads: tuple[Spread, ...]
    """Of the unaided INS, one for each grade."""
    tracks: Mapping[Setting, Tracks]
    """Of both ways of aiding."""
    snapshots: tuple[Snapshot, ...]
    drift: Mapping[tuple[float, str], float]
    """m, RMS of the unaided INS at `Plan.gain_time` by theory, by heading error (rad) and
    grade."""
    signal: Mapping[str, AlongTrack]
    """By quantity."""
    profile: ProfileExample
    window: WindowExample

    def row(self, row: PublishedRow, matcher: str = PAPER) -> Outcome:
        """Return the outcome that belongs to a row of Table 4 or 6."""
        return self.outcomes[Setting(row.quantity, row.sigma, row.batch_length, matcher)]

    def at(self, quantity: str, sigma: float, batch_length: int, matcher: str = PAPER) -> Outcome:
        """Return the outcome of a case of the tables."""
        return self.outcomes[Setting(quantity, sigma, batch_length, matcher)]

    def unaided(self, grade: str) -> Outcome:
        """Return the outcome of the unaided navigator of a grade."""
        return self.outcomes[Setting(grade=grade, aided=False)]

    def snr(self, row: PublishedRow) -> float:
        """Signal-to-noise ratio along the track, 20 log10(RMS signal / sigma), dB."""
        signal = self.signal[row.quantity].signal
        return 20.0 * math.log10(float(np.sqrt(np.mean(signal**2))) / row.sigma)
