"""Whether an aid that says where the vehicle is, satellites above all, can be right: solution
separation (Brown & McBurney 1988; docs/mathematics.md, section 3.15).

Beside the navigator that uses the aid there are others that have not used it since a time, nor
fixes by the map, which are of a navigator with it: they go by inertial data and other aids. Of
filters that take the same data but for some, the difference of the estimates has the difference
of their covariances. Where it is larger than that allows, and than the aid may be off beside what
it says, as by other paths of satellites' signals, it has been wrong since a time after the one
that shows it most clearly. The navigator goes on from there as if it had never been, and uses it
again when it has agreed with the navigator for a while.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from isogal.earth.frames import horizontal_difference
from isogal.fusion.measurements import (
    OF_FIXES,
    Innovation,
    Measurement,
    Outcome,
    PositionFix,
    Widening,
)
from isogal.fusion.measurements.ground_velocity import GNSS
from isogal.fusion.mixture import Mixture
from isogal.fusion.model import quantile
from isogal.fusion.state import FilterState

if TYPE_CHECKING:
    from isogal.fusion.inertial_navigator import InertialNavigator

ANY = ""
"""Instead of an aid's name: all."""
LOOK = 10.0
"""s from one comparison to the next."""
BRANCH = 60.0
"""s from one navigator without the aid to the next that begins."""
MOST = 8
"""Of them at most; those kept are about equally far apart in the logarithm of their age."""
SEPARATION = quantile(1e-9, 2)
"""Of the normalised difference squared that an aid does not reach by chance."""
CONTRADICTS = quantile(0.01, 2)
"""The same of what it said before, which is to be kept."""
OTHER_PATHS = 5.0
"""m, 1-sigma of what satellites' signals that come by other paths may add to a position beside
what is said of it, for hours; of another aid its white noise, where that is more."""
OTHER_DOPPLER = 0.1
"""m/s, the same of a velocity."""
REJECTED_FOR = 60.0
"""s of fixes beyond the gate, one after the other, after which they are no outliers."""
AGREES, AGREED_FOR = 0.01, 300.0
"""Probability that a true fix or velocity does not agree, if other paths add as much as they may,
and for how many s all have to agree before satellites are used again."""
NOT_LINEAR = 0.2
"""rad, 1-sigma of an attitude by which a navigator without the aid may be wrong by more than its
covariance says: it contradicts nothing."""


class Without(NamedTuple):
    """What is known without an aid since a time."""

    since: float
    """That time, s."""
    time: float
    """What is known when, s."""
    after: Mixture


def aid_of(measurement: Measurement) -> str:
    """Return which aid that says where the vehicle is a measurement is of; empty = of none."""
    return str(getattr(measurement, "source", ""))


def of_aid(measurement: Measurement, source: str = "") -> bool:
    """Whether a measurement is of an aid that says where the vehicle is, by its name, or of any
    (empty)."""
    own = aid_of(measurement)
    return bool(own) and source in ("", own)


def by_itself(measurement: Measurement) -> bool:
    """Whether a measurement says the same whatever the navigator has known before: not what a fix
    says, which is the posterior of a matcher less its prior, of a navigator with all aids."""
    if isinstance(measurement, PositionFix):
        return of_aid(measurement)
    return not isinstance(measurement, OF_FIXES)


@dataclass(slots=True)
class AidMonitor:
    """Compares a navigator with those that do not use an aid."""

    source: str
    """Its name."""
    wrong_since: float | None = None
    """s; None = it is used."""
    detected: float = math.nan
    """When that was found, s."""
    _other_paths: float = OTHER_PATHS
    _branches: list[Without] = field(default_factory=list)
    _alone: list[Without] = field(default_factory=list)
    """As long, and without any aid that says where the vehicle is."""
    _next_look: float = -math.inf
    _next_branch: float = -math.inf
    _rejected_since: float = math.nan
    _agreed_since: float = math.nan

    def without(self, now: float) -> Without | None:
        """Return what was known a few seconds before a time (s) without the aid since it came, or
        for as long as is kept; None where it is not used."""
        if self._branches and now <= self._branches[0].time + 2.0 * LOOK:
            return self._branches[0]
        return None

    def untrusted(
        self, navigator: "InertialNavigator", measurements: Sequence[tuple[float, Measurement]]
    ) -> list[Innovation] | None:
        """Return what becomes of measurements of the aid that are not used; None = they may be."""
        if self.wrong_since is None:
            last = self._next_look - LOOK
            if navigator.time > last + min(BRANCH, navigator.horizon):  # it comes, or is back
                self.begin(navigator)
            return None
        found = []
        for time, one in measurements:
            state = navigator.state_at(time).copy()
            for at, sigma in self._unstated:
                state.covariance[at : at + 2, at : at + 2] += np.eye(2) * sigma**2
            innovation = one.update(state, navigator.model)
            agrees = innovation.nis <= quantile(AGREES, len(innovation.innovation))
            if not agrees:
                self._agreed_since = math.nan
            elif math.isnan(self._agreed_since):
                self._agreed_since = time
            innovation.outcome = Outcome.UNTRUSTED
            name = "satellites have" if self.source == GNSS else "the aid has"
            innovation.reason = f"{name} been wrong since {self.wrong_since:.0f} s"
            found.append(innovation)
        if navigator.time - self._agreed_since > AGREED_FOR:
            self.wrong_since = None
            self.begin(navigator)
        return found

    def begin(self, navigator: "InertialNavigator") -> None:
        """Compare from here on."""
        self._clear()
        self._branch(navigator)
        self._next_look = navigator.time + LOOK

    @property
    def _unstated(self) -> tuple[tuple[int, float], ...]:
        """The first of two states, and the 1-sigma that it may be off beside what is said."""
        return (0, self._other_paths), (3, OTHER_DOPPLER)

    def note(
        self,
        navigator: "InertialNavigator",
        time: float,
        measurement: Measurement,
        result: Innovation,
    ) -> None:
        """Take notice of a measurement that has been applied."""
        if isinstance(measurement, Widening) and self._branches:
            # by the map the navigator, which went by its aids, is not where it believes
            since = self._branches[0].since
            navigator.forget(ANY, Without(time, navigator.time, navigator.known))
            _distrust(navigator, self._in_use(navigator), since)
        own = of_aid(measurement, self.source)
        of_it = [] if own else self._branches
        if not of_aid(measurement, ANY):
            pairs = zip(self._alone, self._branches, strict=True)
            of_it = [*of_it, *(alone for alone, other in pairs if alone is not other)]
        for branch in of_it:
            if time <= branch.time + 1e-6 and result.used and by_itself(measurement):
                branch.after.update(measurement, navigator.model)
        if not own:
            return
        if isinstance(measurement, PositionFix):
            white = math.sqrt(np.diag(measurement.covariance)[:2].max())
            self._other_paths = max(OTHER_PATHS, white)
            if result.outcome is not Outcome.REJECTED:
                self._rejected_since = math.nan
            elif math.isnan(self._rejected_since):
                self._rejected_since = time
        if navigator.time >= self._next_look:
            self._look(navigator)

    def _look(self, navigator: "InertialNavigator") -> None:
        now = navigator.time
        self._next_look = now + LOOK
        self._branches = [navigator.later(one, self.source) for one in self._branches]
        several = len(navigator.monitors) > 1
        self._alone = [
            navigator.later(one, ANY) if several else other
            for one, other in zip(self._alone, self._branches, strict=True)
        ]
        separations = [self._separation(navigator.state, one) for one in self._branches]
        if now - self._rejected_since > REJECTED_FOR:
            # what was rejected has done nothing; what came before it, and was false, may have
            before = sum(one.since < self._rejected_since for one in self._branches)
            false = max(separations[:before], default=0.0) > CONTRADICTS
            self._undo(navigator, before - 1 if false else None)
        elif separations and max(separations) > SEPARATION:
            self._undo(navigator, int(np.argmax(separations)))
        elif now >= self._next_branch:
            self._branch(navigator)
            if len(self._branches) > MOST:
                least = self._superfluous(now)
                del self._branches[least], self._alone[least]

    def _undo(self, navigator: "InertialNavigator", last: int | None) -> None:
        """Go on from the newest branch that is right, up to that of an index; None = there is
        nothing to be undone.

        Where other aids are used, too, the branch shows that they disagree with this one. Wrong
        are those that inertial data alone contradict, or all where these do not tell."""
        if last is None:
            _distrust(navigator, [self], self._rejected_since)
            return
        k = self._right_until(last)
        since = self._branches[k].since
        others = [one for one in self._in_use(navigator) if one is not self]
        wrong = others if others and self._contradicted(k) else []
        if not others or any(one._contradicted(one._nearest(since)) for one in others):
            wrong = [self, *wrong]
        wrong = wrong or [self, *others]
        if len(wrong) == 1:
            blamed = wrong[0]
            branch = blamed._branches[blamed._nearest(since)]
            navigator.forget(blamed.source, navigator.later(branch, blamed.source))
        else:
            navigator.forget(ANY, self._alone[k])
        _distrust(navigator, wrong, since)

    def _in_use(self, navigator: "InertialNavigator") -> list["AidMonitor"]:
        return [one for one in navigator.monitors.values() if one._branches]

    def _contradicted(self, k: int) -> bool:
        """Whether inertial data alone contradict the other aids that a branch has used."""
        state = self._branches[k].after.merged
        return self._separation(state, self._alone[k]) > CONTRADICTS

    def _nearest(self, since: float) -> int:
        """Return the branch that began nearest to a time (s)."""
        return int(np.argmin([abs(one.since - since) for one in self._branches]))

    def _right_until(self, last: int) -> int:
        """Return the newest branch up to that of an index which none older one contradicts: what
        the aid has said before it began was right as well."""
        for k, one in enumerate(self._branches[1 : last + 1], start=1):
            state = one.after.merged
            apart = max(self._separation(state, older) for older in self._branches[:k])
            if apart > CONTRADICTS:
                return k - 1
        return last

    def _branch(self, navigator: "InertialNavigator") -> None:
        """Let another navigator without the aid begin."""
        now, known = navigator.time, navigator.known.copy()
        self._next_branch = now + BRANCH
        for state in known.states:  # the map may be worse than has been learnt by then
            state.residual_gravity[0] = max(
                state.residual_gravity[0], navigator.model.gravity.most_left
            )
        self._branches.append(Without(now, now, known))
        self._alone.append(Without(now, now, known.copy()))

    def _separation(self, full: FilterState, branch: Without) -> float:
        """Return the normalised squared difference of a state with the aid, or for longer, and one
        without, of the positions or of the velocities, whichever is larger."""
        without = branch.after.merged
        if math.sqrt(np.trace(without.covariance[6:9, 6:9])) > NOT_LINEAR:
            return 0.0
        apart = horizontal_difference(*full.position[:2], *without.position[:2])
        faster = (full.velocity - without.velocity)[:2]
        found = []
        for (at, sigma), difference in zip(self._unstated, (apart, faster), strict=True):
            part = slice(at, at + 2), slice(at, at + 2)
            values, axes = np.linalg.eigh(without.covariance[part] - full.covariance[part])
            allowed = np.maximum(values, 0.0) + sigma**2
            found.append(float(((axes.T @ difference) ** 2 / allowed).sum()))
        return max(found)

    def _superfluous(self, now: float) -> int:
        """Return which branch is missed least: not the oldest, nor the newest."""
        age = now - np.array([one.since for one in self._branches]) + BRANCH
        return 1 + int(np.argmin(age[:-2] / age[2:]))

    def _clear(self) -> None:
        self._branches, self._alone = [], []
        self._agreed_since = self._rejected_since = math.nan


def _distrust(navigator: "InertialNavigator", wrong: list[AidMonitor], since: float) -> None:
    """Some aids are wrong; navigators without other ones, which have used them, are no measure."""
    for one in wrong:
        one.wrong_since, one.detected = since, navigator.time
    for one in navigator.monitors.values():
        one._clear()
