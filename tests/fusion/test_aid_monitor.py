"""Satellites that are wrong are found out, undone, and used again when they are right."""

import numpy as np
import pytest

from helpers.navigators import ROUTE, fly, start_of
from isogal.earth.frames import horizontal_difference
from isogal.fields.known_gravity import WORST_MAP_SIGMA, KnownGravity, Residual
from isogal.fusion.aid_monitor import AGREED_FOR, REJECTED_FOR
from isogal.fusion.assumed import filter_model
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import (
    LearntMapError,
    Outcome,
    position_fix,
    satellite_velocity,
)
from isogal.fusion.state import FilterState
from isogal.scenario import Deception, Gnss, Gravity, PositionAid, Scenario
from isogal.sensors.satellites import simulate_satellites

GNSS = Gnss(available=((0.0, 1200.0),))
FLIGHT = fly(route=ROUTE.model_copy(update={"duration": 1200.0}), gnss=GNSS)
SATELLITES = "gnss"
WALK = {"kind": "walk", "rate": 0.4, "start": 300.0}


def fixes_of(run: int = 0, **deception):
    gnss = GNSS.model_copy(update={"deception": Deception(**deception)})
    return simulate_satellites(gnss, FLIGHT.trajectory, 0, [run])


def flown(fixes, until: int, heard=lambda k: True, **keys) -> InertialNavigator:
    return on(InertialNavigator(FLIGHT.model, FLIGHT.start, **keys), fixes, until, heard)


def on(it, fixes, until: int, heard=lambda k: True) -> InertialNavigator:
    for k in range(round(it.time), until):
        it.imu(k + 1.0, *FLIGHT.samples(k, k + 1))
        if heard(k + 1):
            it.measure(k + 1.0, position_fix(GNSS.positions, fixes[0].values[0, k], False))
            velocity = satellite_velocity(GNSS, fixes[1].values[0, k], np.zeros(3))
            it.measure(k + 1.0, velocity)
    return it


def off(it: InertialNavigator) -> float:
    """m, from the truth."""
    k, truth = round(it.time), FLIGHT.trajectory
    place = it.state.position[:2]
    return float(np.hypot(*horizontal_difference(*place, truth.latitude[k], truth.longitude[k])))


def test_honest_ones_are_used() -> None:
    it = flown(fixes_of(), 1200)
    assert it.monitors[SATELLITES].wrong_since is None
    assert off(it) < 6.0


def test_what_false_ones_have_done_is_undone() -> None:
    """The state is that of a navigator which has not heard them since."""
    fixes = fixes_of(**WALK)
    it = flown(fixes, 700)
    monitor = it.monitors[SATELLITES]
    assert monitor.wrong_since < monitor.detected < 700.0
    assert monitor.wrong_since < WALK["start"] + 30.0
    other = flown(fixes, 700, lambda k: k <= monitor.wrong_since)
    np.testing.assert_allclose(it.state.covariance, other.state.covariance, rtol=1e-9)
    np.testing.assert_allclose(it.state.position, other.state.position, rtol=1e-14)
    assert off(it) < 4.0 * np.sqrt(np.trace(it.state.covariance[:2, :2])) < 100.0


def test_they_are_used_again_when_they_have_agreed_for_a_while() -> None:
    """Velocities by other paths may be off by 0.1 m/s for a long time, three times their noise,
    which does not hold back trust."""
    back = 500
    fixes = fixes_of(**WALK, end=float(back))
    fixes[1].values[0, back:, 0] += 0.1
    it = flown(fixes, round(back + AGREED_FOR) - 5)
    assert it.monitors[SATELLITES].wrong_since is not None
    on(it, fixes, round(back + AGREED_FOR) + 30)
    assert it.monitors[SATELLITES].wrong_since is None


def test_fixes_beyond_the_gate_one_after_the_other_are_no_outliers() -> None:
    jump = fixes_of(kind="jump", size=5000.0, start=100.0)
    it = flown(jump, round(100.0 + REJECTED_FOR) + 3)
    assert it.monitors[SATELLITES].wrong_since == pytest.approx(100.0)
    said = it.measure(it.time, position_fix(GNSS.positions, jump[0].values[0, 170], False))
    assert said.outcome is Outcome.UNTRUSTED
    assert "wrong since 100 s" in said.reason


USBL = PositionAid(name="usbl", sigma=5.0, interval=10.0)


def positions(until: int, wrong: float = 0.0, satellites: float | None = None):
    """A navigator with positions every 10 s that walk off at a rate (m/s) from 300 s on, and
    perhaps with satellites that do so at another."""
    it = InertialNavigator(FLIGHT.model, FLIGHT.start)
    rng = np.random.default_rng(7)
    fixes = fixes_of(**WALK | {"rate": satellites}) if satellites else fixes_of()
    for k in range(until):
        it.imu(k + 1.0, *FLIGHT.samples(k, k + 1))
        if satellites is not None:
            it.measure(k + 1.0, position_fix(GNSS.positions, fixes[0].values[0, k], False))
        if (k + 1) % 10 == 0:
            north, east = USBL.sigma * rng.standard_normal(2)
            place = FLIGHT.fix(k + 1, north + wrong * max(0, k - 300), east)
            it.measure(k + 1.0, position_fix(USBL, np.array([*place, FLIGHT.height[k]]), False))
    return it


@pytest.mark.parametrize(("wrong", "until", "found"), [(0.0, 1200, None), (0.3, 1080, 1000.0)])
def test_positions_of_another_aid_are_judged_likewise(wrong, until, found) -> None:
    """A slow walk has been believed for long when it shows, and all of that is undone."""
    it = positions(until, wrong)
    monitor = it.monitors[USBL.prefix]
    if found is None:
        assert monitor.wrong_since is None
        assert off(it) < 8.0
    else:
        assert monitor.wrong_since is not None
        assert monitor.detected < found
        assert off(it) < 2.5 * np.sqrt(np.trace(it.state.covariance[:2, :2]))


@pytest.mark.parametrize(
    ("wrong", "satellites", "blamed"),
    [
        (0.3, 0.0, {USBL.prefix}),
        (0.0, 0.4, {SATELLITES}),
        (0.0, 0.1, {SATELLITES, USBL.prefix}),
    ],
)
def test_of_two_that_disagree_inertial_data_tell_which_is_wrong(wrong, satellites, blamed) -> None:
    """Where they do not, neither is used."""
    it = positions(1000, wrong, satellites)
    assert {name for name, one in it.monitors.items() if one.wrong_since is not None} == blamed
    assert off(it) < 3.0 * np.sqrt(np.trace(it.state.covariance[:2, :2]))


def test_what_a_bad_map_leaves_of_gravity_is_not_held_against_them() -> None:
    """Those without satellites allow for it, unless it is specified how much that is."""
    for sigma in (None, 1e-5):
        residual = Residual(0.0, 1.0, sigma)
        scenario = Scenario(route=ROUTE, gravity=Gravity(field="normal"), gnss=GNSS)
        model = filter_model(scenario, KnownGravity(residual=residual, map_sigma=2e-5))
        start = FilterState.start(start_of(scenario, FLIGHT.trajectory, 0), model)
        it = on(InertialNavigator(model, start), fixes_of(), 50)
        it.measure(50.0, LearntMapError(1e-6, 4000.0))
        on(it, fixes_of(), 200)
        most = residual.given(WORST_MAP_SIGMA, 4000.0)[0]
        assert it.state.residual_gravity[0] == residual.given(1e-6, 4000.0)[0]
        without = it.monitors[SATELLITES]._branches
        assert len(without) > 2
        for one in without:
            assert one.after.merged.residual_gravity[0] == pytest.approx(most)
