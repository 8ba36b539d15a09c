"""Simulated soundings of several beams: where each meets the ground, and what is wrong with its
range (docs/mathematics.md, section 2.7)."""

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.fields.map_error import TrueMapError
from isogal.inertial.rotations import matrix
from isogal.maps.channels import RouteMap
from isogal.scenario import Altimeter
from isogal.seeds import generator
from isogal.sensors.altimeter import beam_directions
from isogal.sensors.noise import Noise
from isogal.sensors.trajectory import Trajectory

_ROUNDS, _CLOSE = 60, 1e-4
"""Steps along a beam at most until it meets the ground, and how closely (m)."""


class Footprints:
    """Where the B beams of a route's scans meet the ground.

    Parameters
    ----------
    altimeter : Altimeter
    trajectory : Trajectory
    field_map : RouteMap
        Of terrain height.
    index : (S,) array
        Scans by their index in the trajectory.

    Raises
    ------
    InputError
        The vehicle is not above the ground, or a beam leaves the map.
    """

    def __init__(
        self, altimeter: Altimeter, trajectory: Trajectory, field_map: RouteMap, index: Integers
    ) -> None:
        self.body = beam_directions(altimeter)
        """(B, 3) directions, body axes."""
        attitude = matrix(trajectory.attitude[index])
        self._ray = np.einsum("sij,bj->sbi", attitude, self.body)
        self._map, self._height = field_map, trajectory.height[index][:, None]
        self._place = trajectory.latitude[index][:, None], trajectory.longitude[index][:, None]
        self._axes = [one[:, None] for one in metres_per_radian(trajectory.latitude[index])]
        self.range = self.met(0.0)
        """(S, B) m, over the terrain of the map."""

    def places(self, length: Array) -> tuple[Array, Array]:
        """Return latitude and longitude (S, B) rad at lengths (S, B) m along the beams."""
        north, east = self._axes
        return (
            self._place[0] + length * self._ray[..., 0] / north,
            self._place[1] + length * self._ray[..., 1] / east,
        )

    def met(self, higher: Array | float) -> Array:
        """Return (S, B) the lengths of the beams to a terrain that is higher than the map by (S,
        B) m there."""
        down = self._ray[..., 2]
        length = np.zeros(down.shape)
        slope = -down  # of the clearance at the beam's end, per m along it
        before = change = np.zeros(down.shape)
        for step in range(_ROUNDS):
            clearance = self._height - length * down - self._value(length) - higher
            if step == 0 and (clearance <= 0.0).any():
                s = int(np.argmin(clearance.min(axis=1)))
                latitude, longitude = (np.degrees(axis[s, 0]) for axis in self._place)
                raise InputError(
                    f"route.height: the vehicle is {-float(clearance[s].min()):.0f} m below the"
                    f" terrain at latitude {latitude:.4f}, longitude {longitude:.4f} deg"
                )
            if np.abs(clearance).max() < _CLOSE:
                return length
            if step:
                # a secant, but never steeper than a slope of the ground along the beam allows
                moved = np.where(np.abs(change) > 1e-9, change, 1.0)
                found = np.where(np.abs(change) > 1e-9, (clearance - before) / moved, slope)
                slope = np.clip(found, -4.0, -0.2 * down)
            before, change = clearance, -clearance / slope
            length = np.maximum(length + change, 0.0)
        raise InputError(
            f"altimeter: a beam does not meet the terrain of map {self._map.provenance} clearly;"
            " give a smaller opening"
        )

    def _value(self, length: Array) -> Array:
        latitude, longitude = self.places(length)
        value = self._map.value(latitude, longitude)
        if not np.isfinite(value).all():
            raise InputError(
                f"map {self._map.provenance}: does not cover all beams of the altimeter"
            )
        return value


def simulate_soundings(map_error: TrueMapError, field_map: RouteMap, common: Array) -> Array:
    """Return (R, S, B, 3) what the beams report, m to the ground in body axes, before the
    instrument's rounding.

    Parameters
    ----------
    map_error : TrueMapError
        Of S scans of R runs.
    field_map : RouteMap
        Of terrain height.
    common : (R, S) array
        m by which all beams of a scan find the ground too deep: tide, drift, the map's datum.
    """
    truth, trajectory = map_error.truth, map_error.trajectory
    index, runs = map_error.index, map_error.runs
    foot = Footprints(truth.altimeter, trajectory, field_map, index)
    settings, steep = truth.gravimeter, foot.body[:, 2]
    uncertain = truth.map_error.sigma > 0.0
    higher = map_error.at(*foot.places(foot.range))
    white = Noise("beam", settings.sigma, settings.outlier_fraction, settings.outlier_sigma)
    sensed = np.empty((len(runs), *foot.range.shape, 3))
    for row, run in enumerate(runs):
        length = foot.met(higher[row]) if uncertain else foot.range
        noise = white.draw(truth.seed, run, trajectory.time[index], (len(foot.body),))
        scale = generator(truth.seed, run, "sound_speed").standard_normal()
        scale = 1.0 + truth.altimeter.scale_sigma * scale
        measured = scale * length + (noise + common[row][:, None]) / steep
        sensed[row] = measured[..., None] * foot.body
    return sensed
