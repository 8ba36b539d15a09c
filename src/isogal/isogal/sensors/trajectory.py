"""The true route, and what a perfect IMU measures on it (docs/mathematics.md, section 3.1).

The vehicle stays level and points along its course. Within a step of the navigator heading rate
and acceleration are constant; position follows by a fourth-order Runge-Kutta step, and the IMU's
means over the step by three-point Gauss-Legendre quadrature of the continuous specific force and
angular rate, so the readings do not share the strapdown's approximations."""

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TypeVar

import numpy as np

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.earth.ellipsoid import E2, EARTH_RATE, curvature, radii
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.files import changed_at
from isogal.inertial.rotations import from_heading
from isogal.scenario import Route, Settings
from isogal.sensors.recorded_track import NEAREST_POLE_DEG, Followed, follow, read_positions
from isogal.sensors.reduction import State

Numbers = TypeVar("Numbers", float, Array)


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Truth at the K + 1 ends of K steps of the navigator, and a perfect IMU's means over the
    steps."""

    time: Array
    """(K + 1,) s."""
    latitude: Array
    """(K + 1,) rad."""
    longitude: Array
    """(K + 1,) rad."""
    height: Array
    """(K + 1,) m above the ellipsoid."""
    velocity: Array
    """(K + 1, 3) m/s, north, east, down."""
    attitude: Array
    """(K + 1, 4) quaternion body to NED."""
    specific_force: Array
    """(K, 3) m/s², body axes."""
    angular_rate: Array
    """(K, 3) rad/s, body axes, relative to inertial space."""
    begin: float = 0.0
    """s, time 0 on the clock of the recorded track that is followed."""

    @property
    def dt(self) -> float:
        """Step of the navigator, s."""
        return float(self.time[1] - self.time[0])

    def __len__(self) -> int:
        """Count the steps K."""
        return self.specific_force.shape[0]

    @property
    def position(self) -> Array:
        """(K + 1, 3) latitude, longitude (rad), height (m)."""
        return np.stack([self.latitude, self.longitude, self.height], axis=1)

    def at(self, index: Integers) -> State:
        """Return position and velocity at some ends of steps (N,), counted from 0."""
        place = self.latitude[index], self.longitude[index], self.height[index]
        return State(*place, *self.velocity[index, :2].T)


def build_trajectory(settings: Settings) -> Trajectory:
    """Return the truth of a route.

    Raises
    ------
    InputError
        The route is shorter than the duration asked for or passes a pole, or its recorded track
        cannot be followed.
    """
    if settings.route.track is not None:
        rate, samples = settings.navigation_rate, settings.samples_per_step
        return _along(followed(settings), rate, samples)
    return _build(settings.route, settings.navigation_rate)


def followed(settings: Settings) -> Followed:
    """Return how the recorded track of a scenario is followed; raises InputError where it cannot
    be."""
    rate, samples = settings.navigation_rate, settings.samples_per_step
    changed = changed_at(settings.route.track or "")
    return follow(settings.route, rate, samples, settings.height.measured, changed)


@lru_cache(maxsize=2)
def _along(found: Followed, rate: float, samples: int) -> Trajectory:
    states = found.states[::samples]
    means = found.means.reshape(-1, samples, 6).mean(axis=1)
    latitude, longitude, height = states[:, :3].T
    return Trajectory(
        time=np.arange(len(states)) / rate,
        latitude=latitude,
        longitude=longitude,
        height=height,
        velocity=states[:, 3:6],
        attitude=states[:, 6:],
        specific_force=means[:, :3],
        angular_rate=means[:, 3:],
        begin=found.start,
    )


def first_place(route: Route) -> tuple[float, float]:
    """Return latitude and longitude (rad) where a route begins; raises InputError where its
    recorded track cannot be read."""
    if route.track is not None:
        found = read_positions(route.track, route.track_line, changed_at(route.track))
        latitude, longitude = found.place[0].tolist()
        return latitude, longitude
    first = route.waypoints[0][:2] if route.waypoints is not None else route.start
    assert first is not None  # the scenario model has checked
    return math.radians(first[0]), math.radians(first[1])


@lru_cache(maxsize=8)
def _build(route: Route, rate: float) -> Trajectory:
    rows, rates = drive(route, rate)
    lat, lon, heading, speed = rows.T
    start, dt = np.stack([lat[:-1], heading[:-1], speed[:-1]], axis=1), 1.0 / rate
    force, angular_rate = sensor_means(start, lat[1:], rates, route.height, dt)
    k = len(rates)
    return Trajectory(
        time=np.arange(k + 1, dtype=np.float64) * dt,
        latitude=lat,
        longitude=lon,
        height=np.full(k + 1, route.height),
        velocity=np.stack(
            [speed * np.cos(heading), speed * np.sin(heading), np.zeros(k + 1)], axis=-1
        ),
        attitude=from_heading(heading),
        specific_force=force,
        angular_rate=angular_rate,
    )


@lru_cache(maxsize=8)
def drive(route: Route, rate: float) -> tuple[Array, Array]:
    """Return how a route is driven in K steps at a rate (Hz).

    Returns
    -------
    (K + 1, 4) array
        Latitude, longitude (rad), heading (rad), speed (m/s) at the ends of the steps.
    (K, 2) array
        Heading rate (rad/s) and acceleration (m/s²) in each step.

    Raises
    ------
    InputError
        See `build_trajectory`.
    """
    dt = 1.0 / rate
    guide = _Guide(route, dt)
    steps = None if route.duration is None else round(route.duration * rate)
    lat, lon = guide.start
    heading, speed = guide.heading, guide.speed
    rows: list[tuple[float, float, float, float]] = [(lat, lon, heading, speed)]
    rates: list[tuple[float, float]] = []
    while steps is None or len(rates) < steps:
        if guide.arrived(lat, lon, heading, speed):
            if steps is None:
                break
            raise InputError(
                f"route.duration: the route ends after {len(rates) * dt:.0f} s, duration asks for"
                f" {route.duration:.0f} s; shorten duration, or give null to drive to the end"
            )
        if len(rates) > guide.most_steps:
            raise InputError(
                f"route.waypoints: point {guide.leg + 1} is never reached with turn_rate"
                f" {route.turn_rate:g} rad/s (the vehicle circles round it); raise turn_rate, or"
                " move the points apart"
            )
        turn, acceleration = 0.0, 0.0
        if len(rates) >= guide.rest_steps:
            turn, acceleration = guide.command(lat, lon, heading, speed)
        lat, lon = runge_kutta(lat, lon, heading, speed, turn, acceleration, route.height, dt)
        heading += turn * dt
        speed += acceleration * dt
        rows.append((lat, lon, heading, speed))
        rates.append((turn, acceleration))
        if abs(lat) > math.radians(NEAREST_POLE_DEG):
            raise InputError(
                f"route: passes a pole after {len(rates) * dt:.0f} s, must stay within"
                f" {NEAREST_POLE_DEG:g} deg north and south; give waypoints that lead round it"
            )
    if len(rates) < 2:
        raise InputError("route: must last at least two IMU samples")
    return np.array(rows), np.array(rates)


@kernel
def _position_rates(
    lat: Numbers, heading: Numbers, speed: Numbers, height: float
) -> tuple[Numbers, Numbers]:
    m, n = curvature(np.sin(lat))
    return (
        speed * np.cos(heading) / (m + height),
        speed * np.sin(heading) / ((n + height) * np.cos(lat)),
    )


@kernel
def runge_kutta(
    lat: Numbers,
    lon: Numbers,
    heading: Numbers,
    speed: Numbers,
    turn: Numbers,
    acceleration: Numbers,
    height: float,
    dt: float,
) -> tuple[Numbers, Numbers]:
    """Return latitude and longitude (rad) after dt (s), from those before it, heading (rad), speed
    (m/s) and their constant rates."""
    half = 0.5 * dt
    h1, h2 = heading + turn * half, heading + turn * dt
    s1, s2 = speed + acceleration * half, speed + acceleration * dt
    a = _position_rates(lat, heading, speed, height)
    b = _position_rates(lat + half * a[0], h1, s1, height)
    c = _position_rates(lat + half * b[0], h1, s1, height)
    d = _position_rates(lat + dt * c[0], h2, s2, height)
    return (
        lat + dt / 6.0 * (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0]),
        lon + dt / 6.0 * (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1]),
    )


def sensor_means(
    start: Array, end_latitude: Array, rates: Array, height: float, dt: float
) -> tuple[Array, Array]:
    """Return the means of specific force (K, 3; m/s²) and angular rate (K, 3; rad/s) over K steps
    of dt (s), body axes.

    Parameters
    ----------
    start : (K, 3) array
        Latitude (rad), heading (rad), speed (m/s) at the start of each step.
    end_latitude : (K,) array
        rad, at its end.
    rates : (K, 2) array
        Heading rate (rad/s) and acceleration (m/s²) in it.
    height : float
        m.
    """
    lat, heading, speed = start.T
    turn, acceleration = rates.T
    nodes, weights = np.polynomial.legendre.leggauss(3)
    force = np.zeros((len(rates), 3))
    rate = np.zeros((len(rates), 3))
    for node, weight in zip(0.5 * (nodes + 1.0), 0.5 * weights, strict=True):
        psi = heading + turn * node * dt
        v = speed + acceleration * node * dt
        # latitude within the interval by linear interpolation: 1e-9 rad change gravity by 1e-11
        # m/s² only
        phi = lat + node * (end_latitude - lat)
        s, c = np.sin(phi), np.cos(phi)
        m, n = radii(phi)
        vn, ve = v * np.cos(psi), v * np.sin(psi)
        transport = np.stack(
            [ve / (n + height), -vn / (m + height), -ve * s / c / (n + height)],
            axis=-1,
        )
        earth = np.stack([EARTH_RATE * c, np.zeros_like(c), -EARTH_RATE * s], axis=-1)
        velocity = np.stack([vn, ve, np.zeros_like(vn)], axis=-1)
        f_n = np.cross(2.0 * earth + transport, velocity)
        f_n[:, 2] -= normal_gravity(phi, height)
        force += weight * (
            _to_body(f_n, psi) + np.stack([acceleration, v * turn, np.zeros_like(v)], axis=-1)
        )
        rate += weight * (
            _to_body(earth + transport, psi) + np.stack([0 * turn, 0 * turn, turn], axis=-1)
        )
    return force, rate


def _to_body(vector: Array, heading: Array) -> Array:
    c, s = np.cos(heading), np.sin(heading)
    return np.stack(
        [c * vector[:, 0] + s * vector[:, 1], c * vector[:, 1] - s * vector[:, 0], vector[:, 2]],
        axis=-1,
    )


def _isometric(lat: float) -> float:
    """Return the isometric latitude (Snyder 1987, p. 44)."""
    e = math.sqrt(E2)
    return math.atanh(math.sin(lat)) - e * math.atanh(e * math.sin(lat))


class _Guide:
    """Heading rate and acceleration that lead from point to point."""

    def __init__(self, route: Route, dt: float) -> None:
        self.dt = dt
        self.height = route.height
        if route.waypoints is None:
            # the scenario model has checked it
            assert route.start is not None and route.end is not None
            points = [(*route.start, route.speed), (*route.end, route.speed)]
            self.geodesic = route.line == "geodesic"
        else:
            points = list(route.waypoints)
            self.geodesic = False
        self.points = [(math.radians(a), math.radians(b), v) for a, b, v in points]
        self.turn_limit, self.acceleration_limit = route.turn_rate, route.acceleration
        self.leg = 1
        self.start = self.points[0][:2]
        self.speed = 0.0 if route.at_rest else self.points[0][2]
        self.rest_steps = round(route.at_rest / dt)
        """Steps at rest before it moves off."""
        self.heading = self._azimuth(*self.start)
        self.manoeuvring = len(self.points) > 2 or self.speed != self.points[1][2]
        self.lengths = [self._between(*start[:2], end) for start, end in pairwise(self.points)]
        slowest = min(v for _, _, v in self.points)
        turns = len(self.points) * 2.0 * math.pi / self.turn_limit
        slow = self.points[1][2] / self.acceleration_limit if route.at_rest else 0.0
        seconds = 3.0 * sum(self.lengths) / slowest + turns + slow + route.at_rest
        self.most_steps = int(seconds / dt) + 1000
        """Far more than any route needs that reaches its points."""

    def _azimuth(self, lat: float, lon: float, leg: int | None = None) -> float:
        target = self.points[self.leg if leg is None else leg]
        if self.geodesic:
            from pyproj import Geod

            inverse = Geod(ellps="GRS80").inv(
                math.degrees(lon),
                math.degrees(lat),
                math.degrees(target[1]),
                math.degrees(target[0]),
            )
            return math.radians(inverse[0])
        d_lon = math.remainder(target[1] - lon, 2.0 * math.pi)
        return math.atan2(d_lon, _isometric(target[0]) - _isometric(lat))

    def _distance(self, lat: float, lon: float) -> float:
        return self._between(lat, lon, self.points[self.leg])

    def _between(self, lat: float, lon: float, target: tuple[float, float, float]) -> float:
        north, east = _position_rates(
            0.5 * (lat + target[0]), math.pi / 4, math.sqrt(2.0), self.height
        )
        return math.hypot(
            (target[0] - lat) / north, math.remainder(target[1] - lon, 2.0 * math.pi) / east
        )

    def arrived(self, lat: float, lon: float, heading: float, speed: float) -> bool:
        """Whether the last point is reached (within one step) or, on a straight route, has just
        been passed by; parameters are those of `command`."""
        if self.leg < len(self.points) - 1:
            return False
        distance = self._distance(lat, lon)
        if distance < max(speed * self.dt, 1.0):
            return True
        # at height, or after thousands of km, the line misses its end by metres
        near = not self.manoeuvring and distance < 0.01 * self.lengths[-1]
        return near and math.cos(self._azimuth(lat, lon) - heading) < 0.0

    def command(self, lat: float, lon: float, heading: float, speed: float) -> tuple[float, float]:
        """Return (heading rate rad/s, acceleration m/s²) for the coming interval.

        Parameters
        ----------
        lat, lon, heading : float
            Where the vehicle is and goes, rad.
        speed : float
            m/s.
        """
        if not self.manoeuvring:
            if not self.geodesic:
                return 0.0, 0.0
            # Clairaut: a geodesic's azimuth changes by sin(azimuth) tan(latitude) ds / N;
            # evaluated at the interval's middle
            mid = lat + 0.5 * self.dt * _position_rates(lat, heading, speed, self.height)[0]
            _, n = curvature(math.sin(mid))
            return speed * math.sin(heading) * math.tan(mid) / (n + self.height), 0.0
        radius = speed / self.turn_limit
        if self.leg < len(self.points) - 1:
            corner = math.remainder(
                self._azimuth(*self.points[self.leg][:2], self.leg + 1) - heading, 2.0 * math.pi
            )
            # a corner is rounded off where the turn fits into both legs; a sharper one is overshot
            lead = radius * math.tan(min(abs(corner), 0.5 * math.pi) / 2.0)
            lead = min(lead, 0.5 * self.lengths[self.leg - 1], 0.5 * self.lengths[self.leg])
            if self._distance(lat, lon) <= max(lead, speed * self.dt):
                self.leg += 1
        target_speed = self.points[self.leg][2]
        error = math.remainder(self._azimuth(lat, lon) - heading, 2.0 * math.pi)
        turn = max(-self.turn_limit, min(self.turn_limit, error / self.dt))
        distance = self._distance(lat, lon)
        ahead, aside = distance * math.cos(error), distance * abs(math.sin(error))
        if math.hypot(ahead, aside - radius) < 0.999 * radius:
            turn = 0.0  # the point lies within the turning circle: a turn would never reach it
        acceleration = max(
            -self.acceleration_limit,
            min(self.acceleration_limit, (target_speed - speed) / self.dt),
        )
        return turn, acceleration
