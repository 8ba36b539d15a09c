"""Whether satellites can be right: solution separation (Brown & McBurney 1988;
docs/mathematics.md, section 3.15).

Beside the navigator that uses satellites there are others that have used none since a time, nor
fixes by the map, which are of a navigator with satellites: they go by inertial data and other
aids. Of filters that take the same data but for some, the difference of the estimates has the
difference of their covariances. Where it is larger than that allows, and than satellites may be
off by other paths of their signals, satellites have been wrong since a time after the one that
shows it most clearly. The navigator goes on from there as if they had never been, and uses them
again when they have agreed with it for a while.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from isogal.earth.frames import horizontal_difference
from isogal.fusion.gate import quantile
from isogal.fusion.measurements import (
    InformationUpdate,
    Innovation,
    LearntMapError,
    Measurement,
    Outcome,
    PositionFix,
    Widening,
)
from isogal.fusion.measurements.satellites import GNSS
from isogal.fusion.mixture import Mixture

if TYPE_CHECKING:
    from isogal.fusion.inertial_navigator import InertialNavigator

LOOK = 10.0
"""s from one comparison to the next."""
BRANCH = 60.0
"""s from one navigator without satellites to the next that begins."""
MOST = 8
"""Of them at most; those kept are about equally far apart in the logarithm of their age."""
SEPARATION = quantile(1e-9, 2)
"""Of the normalised difference squared that satellites do not reach by chance."""
OTHER_PATHS = 5.0
"""m, 1-sigma of what signals that come by other paths may add to a position beside what is said of
it, for hours."""
OTHER_DOPPLER = 0.1
"""m/s, the same of a velocity."""
REJECTED_FOR = 60.0
"""s of fixes beyond the gate, one after the other, after which they are no outliers."""
AGREES, AGREED_FOR = quantile(0.01, 2), 300.0
"""Normalised innovation squared up to which a fix agrees, and for how many s all have to before
satellites are used again."""


class Without(NamedTuple):
    """What is known without an aid since a time."""

    since: float
    """That time, s."""
    time: float
    """What is known when, s."""
    after: Mixture


def of_aid(measurement: Measurement, source: str = "") -> bool:
    """Whether a measurement is of an aid that says where the vehicle is, by its name, or of any
    (empty)."""
    own = getattr(measurement, "source", "")
    return bool(own) and source in ("", own)


def by_itself(measurement: Measurement) -> bool:
    """Whether a measurement says the same whatever the navigator has known before: not what a fix
    says, which is the posterior of a matcher less its prior, of a navigator with satellites."""
    if isinstance(measurement, PositionFix):
        return of_aid(measurement)
    return not isinstance(measurement, InformationUpdate | LearntMapError | Widening)


@dataclass(slots=True)
class SatelliteMonitor:
    """Compares a navigator with those that use no satellites."""

    wrong_since: float | None = None
    """s; None = satellites are used."""
    detected: float = math.nan
    """When that was found, s."""
    _branches: list[Without] = field(default_factory=list)
    _next_look: float = -math.inf
    _next_branch: float = -math.inf
    _rejected_since: float = math.nan
    _agreed_since: float = math.nan

    def untrusted(
        self, navigator: "InertialNavigator", measurements: Sequence[tuple[float, Measurement]]
    ) -> list[Innovation] | None:
        """Return what becomes of measurements of satellites that are not used; None = they may be
        used, or are of something else."""
        if not (navigator.model.judges_satellites and of_aid(measurements[0][1], GNSS)):
            return None
        if self.wrong_since is None:
            if navigator.time > self._next_look + LOOK:  # they come, or are back
                self._branches = []
                self._branch(navigator)
                self._next_look = navigator.time + LOOK
            return None
        found = []
        for time, one in measurements:
            state = navigator.state_at(time).copy()
            state.covariance[:2, :2] += np.eye(2) * OTHER_PATHS**2
            innovation = one.update(state, navigator.model)
            agrees = innovation.nis <= AGREES / 2.0 * len(innovation.innovation)
            if not agrees:
                self._agreed_since = math.nan
            elif math.isnan(self._agreed_since):
                self._agreed_since = time
            innovation.outcome = Outcome.UNTRUSTED
            innovation.reason = f"satellites have been wrong since {self.wrong_since:.0f} s"
            found.append(innovation)
        if navigator.time - self._agreed_since > AGREED_FOR:
            navigator.satellites = SatelliteMonitor()
        return found

    def note(
        self,
        navigator: "InertialNavigator",
        time: float,
        measurement: Measurement,
        result: Innovation,
    ) -> None:
        """Take notice of a measurement that has been applied."""
        if not navigator.model.judges_satellites:
            return
        if isinstance(measurement, Widening) and self._branches:
            # by the map the navigator, which went by satellites, is not where it believes
            navigator.forget(GNSS, Without(time, navigator.time, navigator.known))
            self._distrust(navigator.time, self._branches[0].since)
        if not of_aid(measurement, GNSS):
            for branch in self._branches:
                if time <= branch.time + 1e-6 and result.used and by_itself(measurement):
                    branch.after.update(measurement, navigator.model)
            return
        if isinstance(measurement, PositionFix):
            if result.outcome is not Outcome.REJECTED:
                self._rejected_since = math.nan
            elif math.isnan(self._rejected_since):
                self._rejected_since = time
        if navigator.time - self._rejected_since > REJECTED_FOR:
            # the navigator has not used them: there is nothing to be undone
            self._distrust(navigator.time, self._rejected_since)
        elif navigator.time >= self._next_look:
            self._look(navigator)

    def _look(self, navigator: "InertialNavigator") -> None:
        now = navigator.time
        self._next_look = now + LOOK
        self._branches = [navigator.later(one, GNSS) for one in self._branches]
        separations = [self._separation(navigator, one) for one in self._branches]
        if separations and max(separations) > SEPARATION:
            worst = self._branches[int(np.argmax(separations))]
            navigator.forget(GNSS, worst)
            self._distrust(now, worst.since)
            return
        if now >= self._next_branch:
            self._branch(navigator)
            if len(self._branches) > MOST:
                del self._branches[self._superfluous(now)]

    def _branch(self, navigator: "InertialNavigator") -> None:
        """Let another navigator without satellites begin."""
        now = navigator.time
        self._next_branch = now + BRANCH
        self._branches.append(Without(now, now, navigator.known.copy()))

    def _separation(self, navigator: "InertialNavigator", branch: Without) -> float:
        """Return the normalised squared difference with and without, of the positions or of the
        velocities, whichever is larger."""
        full, without = navigator.state, branch.after.merged
        apart = horizontal_difference(*full.position[:2], *without.position[:2])
        faster = (full.velocity - without.velocity)[:2]
        found = []
        for at, difference, sigma in ((0, apart, OTHER_PATHS), (3, faster, OTHER_DOPPLER)):
            part = slice(at, at + 2), slice(at, at + 2)
            values, axes = np.linalg.eigh(without.covariance[part] - full.covariance[part])
            allowed = np.maximum(values, 0.0) + sigma**2
            found.append(float(((axes.T @ difference) ** 2 / allowed).sum()))
        return max(found)

    def _superfluous(self, now: float) -> int:
        """Return which branch is missed least: not the oldest, nor the newest."""
        age = now - np.array([one.since for one in self._branches]) + BRANCH
        return 1 + int(np.argmin(age[:-2] / age[2:]))

    def _distrust(self, now: float, since: float) -> None:
        self.wrong_since, self.detected = since, now
        self._branches = []
        self._agreed_since = self._rejected_since = math.nan
