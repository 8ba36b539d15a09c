"""A map whose datum is wrong, and a true map that is not the one matched."""

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of, wavy
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.fields.map_error import TrueMapError
from isogal.fields.scenario_map import true_map
from isogal.fields.simulator import ReadingSimulator
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.montecarlo.cases import Case
from isogal.montecarlo.engine import simulate
from isogal.scenario import validate_scenario
from isogal.sensors.trajectory import build_trajectory

RUNS = range(400)


def scenario(**keys):
    route = {"start": np.degrees(ORIGIN).tolist(), "end": [-36.4, 147.2], "duration": 600.0}
    return validate_scenario(
        {
            "route": route,
            "gravimeter": {"sigma": 1e-9, "quantity": "disturbance"},
            "gravity": {"field": "normal"},
            "matcher": {"map_sigma": 0.0, "stride": 30},
        }
        | keys
    )


def drawn(runs=RUNS, channels=(), **datum):
    """Errors at scans, and their places from the start, m."""
    it = scenario(map_error=datum)
    trajectory, index = build_trajectory(it), np.arange(10, 601, 10)
    start = trajectory.latitude[0], trajectory.longitude[0]
    north, east = horizontal_difference(
        trajectory.latitude[index], trajectory.longitude[index], *start
    ).T
    return TrueMapError(it.true, trajectory, index, runs).of_datum(channels), north, east


def test_an_offset_is_the_same_at_all_scans_and_a_tilt_is_a_plane_from_the_start():
    error, _, _ = drawn(offset=5e-5)
    assert not np.ptp(error, axis=1).any()
    assert np.std(error[:, 0]) == pytest.approx(5e-5, rel=0.15)  # 4 sigma of 400 draws
    error, north, east = drawn(tilt=1e-9)
    _, residual, *_ = np.linalg.lstsq(np.stack([north, east], axis=1), error.T)
    assert np.sqrt((residual / len(north)).max()) < 1e-3 * np.abs(error).max()
    # north and east grow together on a straight route: only the slope along it is seen
    along = error[:, -1] / np.hypot(north[-1], east[-1])
    assert np.std(along) == pytest.approx(1e-9, rel=0.15)


def test_readings_have_it_and_the_bound_takes_it_for_a_bias_and_a_drift():
    wrong = {"offset": 5e-5, "tilt": 1e-9}
    trajectory, field_map = build_trajectory(scenario()), field_map_of(wavy)
    felt, plain = (
        ReadingSimulator(it.true, trajectory, field_map, [7]).raw
        for it in (scenario(map_error=wrong), scenario())
    )
    np.testing.assert_allclose(felt - plain, drawn([7], **wrong)[0], atol=1e-14)
    instrument = {"quantity": "disturbance", "sigma": 1e-9, "bias": 5e-5, "drift": 22e-9}
    one, other, none = (
        posterior_cramer_rao(scenario(**keys).true, trajectory, field_map).covariance
        for keys in ({"map_error": wrong}, {"gravimeter": instrument}, {})
    )
    np.testing.assert_allclose(one, other, rtol=1e-6)
    assert np.trace(one[-1]) > 2.0 * np.trace(none[-1])


def test_readings_are_of_the_true_map(tmp_path):
    fine, coarse = field_map_of(wavy), field_map_of(lambda north, east: 0.0 * wavy(north, east))
    for name, field_map in (("fine", fine), ("coarse", coarse)):
        write_netcdf(field_map, tmp_path / f"{name}.nc")
    it = scenario(
        map={"source": str(tmp_path / "coarse.nc"), "continuation": "none"},
        truth={"map": {"source": str(tmp_path / "fine.nc")}},
    )
    trajectory = build_trajectory(it)
    assert true_map(it.true, it.map, trajectory, coarse).provenance != coarse.provenance
    assert true_map(it.true, it.true.map, trajectory, fine) is fine
    runs, plain = simulate(it, [0], coarse).detail, simulate(scenario(), [0], fine).detail
    # not more than float32 of the file, as long as no fix has changed velocities
    before = np.s_[..., : it.matcher.batch_length]
    np.testing.assert_allclose(runs.reading[before], plain.reading[before], atol=3e-7)
    assert np.ptp(runs.map_value) < 0.1 * np.ptp(plain.map_value)
    told = it.model_copy(update={"truth": {}})
    assert Case("a", it, 1, coarse).key != Case("a", told, 1, coarse).key
