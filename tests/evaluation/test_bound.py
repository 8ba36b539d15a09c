"""The bound against independent computations: conditioning of one large Gaussian vector, the
bounds of another implementation, and a point-mass filter on a map that is not linear."""

import numpy as np
import pytest
from scipy.linalg import expm

from helpers.route_maps import field, tilted, waves
from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.bound import BoundResult, posterior_cramer_rao, unaided_covariance
from isogal.evaluation.ins_error_model import divide, initial_covariance
from isogal.evaluation.reading_errors import effective_noise_variance
from isogal.fields.measured import measured_field
from isogal.fields.scenario_map import map_for_scenario
from isogal.inertial.error_model import STATES, fill_dynamics
from isogal.scenario import Gravimeter, validate_scenario
from isogal.sensors.gravimeter_errors import missing
from isogal.sensors.imu_model import noise_density
from isogal.sensors.noise import RunScans
from isogal.sensors.trajectory import build_trajectory

WAVES = field(waves)
HALF_AN_HOUR = {"route": {"duration": 1800.0}}


def scenario(**sections):
    """A scenario of half an hour if nothing else is said."""
    return validate_scenario(HALF_AN_HOUR | sections)


def bound(field_map=WAVES, how=None, **sections):
    """Bound of a scenario; of the unaided navigator where there is no map."""
    settings = scenario(**sections)
    trajectory = build_trajectory(settings)
    if field_map is None:
        return unaided_covariance(settings.true, trajectory)
    return posterior_cramer_rao(settings.true, trajectory, field_map, **(how or {}))


def rms(field_map=WAVES, **sections):
    """RMS error at the end."""
    return float(bound(field_map, **sections).rms[-1])


def _dense(settings, trajectory, gradient, quantisation, scan=-1):
    """Covariance of the position error at a scan, counted from 0, given all readings, by
    conditioning one big Gaussian vector.

    By matrix exponentials, Van Loan's noise integral and the full covariance of the map's error,
    so it has nothing in common with the recursion."""
    segments = divide(trajectory, settings.steps_per_scan)
    reduction = measured_field(settings).reduction(settings)
    density = np.square(noise_density(settings.imu.sensors, 1.0 / settings.imu.rate))
    P = initial_covariance(settings.initial_error, settings.imu.sensors)
    blocks, crosses, scans = [], [], []
    F = np.zeros((STATES, STATES))
    for k in range(len(segments.geometry)):
        fill_dynamics(F, segments.geometry[k], segments.force[k], segments.rotation[k])
        Q = np.zeros((STATES, STATES))
        C = segments.rotation[k]
        Q[2:4, 2:4] = (C @ np.diag(density[:3]) @ C.T)[:2, :2]
        Q[4:7, 4:7] = C @ np.diag(density[3:]) @ C.T
        joint = expm(np.block([[-F, Q], [np.zeros_like(F), F.T]]) * segments.dt)  # Van Loan 1978
        transition = joint[STATES:, STATES:].T
        P = transition @ P @ transition.T + transition @ joint[:STATES, STATES:]
        # covariance of the present state with that at earlier scans
        crosses = [transition @ cross for cross in crosses]
        if (k + 1) % segments.per_scan == 0:
            i = (k + 1) // segments.per_scan * settings.steps_per_scan
            row = np.zeros(STATES)
            row[:4] = reduction.jacobian(trajectory.at(np.array([i])))[0]
            row[:2] -= gradient
            blocks.append((row, [cross.copy() for cross in crosses], P.copy()))
            crosses.append(P.copy())
            scans.append(i)
    states = np.zeros((len(blocks), len(blocks), STATES, STATES))
    for j, (_, earlier, own) in enumerate(blocks):
        states[j, j] = own
        for i, cross in enumerate(earlier):
            states[j, i], states[i, j] = cross, cross.T
    H = np.array([row for row, _, _ in blocks])
    readings = np.einsum("ia,ijab,jb->ij", H, states, H)
    along = np.array(scans) * trajectory.dt * settings.route.speed
    sigma, length = settings.map_error.sigma, settings.map_error.correlation_length
    readings += sigma**2 * np.exp(-np.abs(along[:, None] - along[None, :]) / length)
    readings += (settings.gravimeter.sigma**2 + quantisation**2 / 12) * np.eye(len(blocks))
    time = np.array(scans) * trajectory.dt
    readings += settings.gravimeter.bias**2 + settings.gravimeter.drift**2 * np.outer(time, time)
    apart = np.abs(time[:, None] - time)
    instrument = settings.gravimeter
    readings += instrument.correlated_sigma**2 * np.exp(-apart / instrument.correlation_time)
    readings += instrument.bias_walk**2 * np.minimum(time[:, None], time)
    cross = np.einsum("jab,jb->aj", states[scan], H)[:2]
    return states[scan, scan][:2, :2] - cross @ np.linalg.solve(readings, cross.T)


SLOW = {
    **{"bias": 2e-5, "drift": 1e-7, "bias_walk": 2e-6},
    **{"correlated_sigma": 2e-5, "correlation_time": 45.0},
}


@pytest.mark.parametrize(("map_error", "errors"), [(0.0, {}), (2e-5, SLOW)], ids=["white", "slow"])
def test_on_a_linear_map_it_is_the_dense_kalman_covariance(map_error, errors):
    settings = scenario(
        route={"duration": 300.0},
        initial_error={"position": 300.0},
        gravimeter={"sigma": 1e-5, **errors},
        map_error={"sigma": map_error, "correlation_length": 2000.0},
    )
    trajectory = build_trajectory(settings)
    field_map = tilted(1e-7, -6e-8, quantisation=2e-6)
    found = posterior_cramer_rao(settings.true, trajectory, field_map, smoothed=True)
    # the dense covariance takes one gradient for the whole route: the map's at its middle
    i = len(trajectory) // 2
    _, north, east = field_map.value_and_gradient(trajectory.latitude[i], trajectory.longitude[i])
    dense = _dense(settings, trajectory, (float(north), float(east)), 2e-6)
    np.testing.assert_allclose(found.covariance[-1], dense, rtol=2e-3)
    for scan in (0, 12, 20, -1):
        dense_then = _dense(settings, trajectory, (float(north), float(east)), 2e-6, scan)
        np.testing.assert_allclose(found.smoothed[scan % 30 + 1], dense_then, rtol=5e-3)
    unaided = unaided_covariance(settings.true, trajectory)
    assert np.trace(dense) < 0.8 * np.trace(unaided.covariance[-1])


def test_a_point_mass_filter_on_a_small_nonlinear_map_attains_the_bound():
    """Exhaustive grid posterior of a constant position error, 300 draws: not better than the
    bound, and close to it."""
    settings = scenario(
        route={"duration": 400.0},
        imu={"grade": "quantum"},
        initial_error={"position": 300.0, "velocity": 0.0, "tilt": 0.0, "heading": 0.0},
        gravimeter={"sigma": 1e-5, "interval": 20.0},
    )
    trajectory = build_trajectory(settings)
    field_map = field(waves, step_deg=0.005)
    bound = posterior_cramer_rao(settings.true, trajectory, field_map)
    scans = np.arange(20, len(trajectory) + 1, 20)
    latitude, longitude = trajectory.latitude[scans], trajectory.longitude[scans]
    north, east = metres_per_radian(latitude)
    random = np.random.default_rng(11)
    axis = np.linspace(-1200.0, 1200.0, 81)
    shift = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    prior = -0.5 * (shift**2).sum(axis=1) / 300.0**2
    truth = field_map.value(latitude, longitude)
    squared = []
    for _ in range(300):
        error = 300.0 * random.standard_normal(2)
        reading = truth + 1e-5 * random.standard_normal(scans.size)
        # where the truth would be if the navigator at `error` had the error `shift`
        offset = error - shift
        value = field_map.value(
            latitude[:, None] + offset[:, 0] / north[:, None],
            longitude[:, None] + offset[:, 1] / east[:, None],
        )
        log = prior - 0.5 * (((reading[:, None] - value) / 1e-5) ** 2).sum(axis=0)
        weight = np.exp(log - log.max())
        mean = weight @ shift / weight.sum()
        squared.append(((error - mean) ** 2).sum())
    ratio = np.mean(squared) / bound.rms[-1] ** 2
    scatter = np.std(squared) / np.sqrt(len(squared)) / bound.rms[-1] ** 2
    # this filter leaves the reductions out; with exact velocity they tell nothing
    assert ratio > 1.0 - 3.0 * scatter
    assert ratio < 1.25 + 3.0 * scatter
    assert bound.rms[-1] < 0.5 * 300.0 * np.sqrt(2.0)


def test_readings_without_gradient_or_off_the_map_tell_nothing():
    settings = {"route": {"duration": 600.0}, "gravimeter": {"sigma": 1.0}}
    unaided = bound(None, **settings).covariance
    np.testing.assert_allclose(bound(tilted(0.0, 0.0), **settings).covariance, unaided, rtol=1e-6)
    elsewhere = field(waves)
    elsewhere.values[:] = np.nan
    elsewhere.values[:5, :5] = 9.8
    np.testing.assert_array_equal(bound(elsewhere, **settings).covariance, unaided)


def test_a_delay_that_is_not_told_costs_the_more_the_longer_it_may_be():
    good, unaided = rms(), rms(None)
    clock, late = (rms(gravimeter={"delay_sigma": sigma}) for sigma in (2.0, 20.0))
    assert 1.02 * good < clock < late < unaided


def test_a_map_that_is_more_wrong_in_some_places():
    def end(sigma, share):
        how = {} if share is None else {"map_share": np.broadcast_to(share, 180)}
        error = {"sigma": sigma}
        return bound(how=how, gravity={"field": "normal"}, map_error=error).rms[-1]

    assert end(1e-5, 3.0) == pytest.approx(end(3e-5, None))
    good_at_the_end = np.where(np.arange(180) < 90, 3.0, 1.0)
    assert end(1e-5, None) < end(1e-5, good_at_the_end) < end(3e-5, None)


def test_the_rate_of_the_imu_hardly_matters():
    results = [bound(route={"duration": 900.0}, imu={"rate": rate}) for rate in (1.0, 5.0, 10.0)]
    for other in results[1:]:
        np.testing.assert_allclose(other.time, results[0].time)
        np.testing.assert_allclose(other.rms, results[0].rms, rtol=1e-3)


@pytest.mark.parametrize(
    ("variable", "quantity", "sigma", "expected"),
    [("ga", "gravity", 2e-4, 221.0), ("dg", "disturbance", 1e-6, 29.0)],
)
def test_bounds_of_the_published_rows(shared_data, variable, quantity, sigma, expected):
    """RMS over the voyage by an independent implementation (docs/mathematics.md, 11.1)."""
    source = str(shared_data / "se_australia_gravity.nc")
    settings = validate_scenario(
        {
            "map": {"source": source, "variable": variable},
            "gravimeter": {"quantity": quantity, "sigma": sigma},
        }
    )
    trajectory = build_trajectory(settings)
    field_map = map_for_scenario(settings, trajectory)
    found = posterior_cramer_rao(settings.true, trajectory, field_map)
    assert np.sqrt(np.mean(found.rms**2)) == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize(
    ("gravimeter", "step", "variance"),
    [
        (Gravimeter(sigma=2e-5), 0.0, 4e-10),
        (Gravimeter(sigma=1e-6), 1e-6, 1e-12 * (1 + 1 / 12)),
        (Gravimeter(sigma=1e-5, outlier_fraction=0.05), 0.0, 1e-10 / (0.95 + 0.05 / 2501.0)),
    ],
)
def test_effective_noise(gravimeter, step, variance):
    assert effective_noise_variance(gravimeter, step) == pytest.approx(variance, rel=1e-9, abs=0)


def test_rms_between_scans():
    bound = BoundResult(
        np.array([0.0, 10.0]), np.array([np.diag([9.0, 16.0]), np.diag([36.0, 64.0])])
    )
    np.testing.assert_allclose(bound.rms_at(np.array([0.0, 5.0, 10.0])), [5.0, 7.5, 10.0])
    assert np.isnan(bound.rms_at(np.array([-1.0, 11.0]))).all()


def test_an_instrument_as_built_gives_larger_bounds():
    def end(sigma=1e-05, **gravimeter):
        return rms(gravimeter={"sigma": sigma, **gravimeter})

    good = end()
    assert good < end(gaps=[[300.0, 900.0]]) < end(gaps=[[0.0, 1700.0]])
    assert end(dead_turn_rate=0.01) == good  # it goes straight
    assert end(cross_coupling=1e-3) == pytest.approx(good, rel=1e-3)
    tilting = end(platform_tilt=2e-3, platform_time=300.0)
    assert tilting == pytest.approx(end(correlated_sigma=9.8 * 4e-6, correlation_time=150.0))
    # late by 5 s: the same field, seen a little later
    assert end(delay=5.0) == pytest.approx(good, rel=0.1)
    assert 0.9 * good < end(filter_time=20.0) < 1.5 * good


def test_readings_missing_by_chance_count_by_their_share():
    """Within the scatter of eight ways of missing them."""
    error = {"map_error": {"sigma": 3e-5}}
    half = scenario(**error, gravimeter={"missing_fraction": 0.5})
    trajectory = build_trajectory(half)
    index = np.arange(10, len(trajectory) + 1, 10)
    each = []
    for run in range(8):
        absent = missing(half.gravimeter, RunScans(half.seed, run, trajectory, index))
        gaps = [[float(trajectory.time[k]) - 1.0, 2.0] for k in index[absent]]
        each.append(bound(gravimeter={"gaps": gaps}, **error).rms[-1] ** 2)
    share = posterior_cramer_rao(half.true, trajectory, WAVES).rms[-1]
    assert share == pytest.approx(np.sqrt(np.mean(each)), rel=0.02)


def test_a_filter_takes_from_the_map_error_what_it_takes_from_the_field():
    # waves of 40 km and a map error of 4 km: the error is filtered away, the field is not
    filtered, delayed = (
        rms(
            tilted(1e-7, -6e-8),
            route={"duration": 3000.0},
            map_error={"sigma": 3e-5},
            gravimeter={key: 100.0, "sigma": 1e-6},
        )
        for key in ("filter_time", "delay")
    )
    assert 0.7 * delayed < filtered < delayed


def test_in_turns_cross_coupling_counts():
    waypoints = [[-37.9, 144.8, 22], [-37.85, 144.9, 22], [-37.9, 145.0, 22]]
    route = {"waypoints": waypoints, "duration": None}
    blind, coupled, clean = (
        rms(route=route, gravimeter=keys)
        for keys in ({"dead_turn_rate": 0.01}, {"cross_coupling": 1.0}, {})
    )
    assert clean < coupled
    # readings of a turn that may be wrong by 0.4 m/s² say nothing but what their two unknown
    # shares leave
    assert coupled < 1.001 * blind


def test_dynamic_pressure_at_a_constant_speed_is_a_constant_offset():
    speed = 22.0
    bias = rms(gravimeter={"bias": 1e-5})
    pressure = rms(gravimeter={"dynamic_pressure": 1e-5 / speed**2})
    assert rms() < pressure == pytest.approx(bias, rel=1e-3)


def test_what_comes_later_informs_the_past_and_costs_nothing():
    both = bound(how={"smoothed": True})
    assert both.smoothed is not None and bound().smoothed is None
    np.testing.assert_array_equal(both.covariance, bound().covariance)
    assert both.smoothed_rms_at(np.array([900.0])) < 0.8 * both.rms_at(np.array([900.0]))
    assert np.isnan(bound().smoothed_rms_at(np.array([900.0]))).all()
