"""Every navigator takes a fix to the same effect."""

import numpy as np
import pytest

from helpers.navigators import error_between, fly, random_covariance
from isogal.fix import apply_fix
from isogal.fusion.buffered import BufferedNavigator
from isogal.fusion.navigator import NavigatorRun
from isogal.matching.interfaces import Fix, Information

MATRIX = np.linalg.inv(random_covariance(np.array([100.0, 80.0, 0.5, 0.4])))
INFORMATION = Information(MATRIX @ np.array([50.0, -30.0, 0.1, 0.2]), MATRIX)
COVARIANCE = np.diag([900.0, 400.0])


@pytest.mark.parametrize("information", [None, INFORMATION], ids=["position", "information"])
@pytest.mark.parametrize("reset", [False, True])
def test_a_run_and_a_buffered_navigator_take_it_alike(information, reset):
    flight = fly(range(2))
    place = flight.fix(0, 40.0, -60.0)
    fix = Fix(0.0, *place, COVARIANCE, information=information, reset=reset)
    runs, before = flight.start.copy(), flight.start.copy()
    innovation, nis = apply_fix(fix, NavigatorRun(runs, flight.model, 1))
    alone = flight.start.copy()
    one = type(alone)(*(array[1:].copy() for array in alone.arrays()))
    navigator = BufferedNavigator(flight.model, one)
    result = apply_fix(fix, navigator.at(0.0))
    assert result.accepted
    assert result.nis == nis
    np.testing.assert_array_equal(result.innovation, innovation[:2])
    for together, single in zip(runs.arrays(), navigator.state.arrays(), strict=True):
        np.testing.assert_array_equal(together[1:], single)
    assert not error_between(runs, before, 0).any()
    assert np.hypot(*error_between(runs, before, 1)[:2]) > 5.0
