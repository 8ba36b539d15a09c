"""A magnetic vehicle in a scenario: what it really adds to the readings, and what is assumed of it
(docs/magnetometer.md, section 7)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.inertial.rotations import matrix
from isogal.magnetics.aircraft import MagneticAircraft
from isogal.magnetics.compensation import Compensation, read_compensation
from isogal.magnetics.online import CALIBRATED_SHARE
from isogal.magnetics.terms import COUNT
from isogal.scenario import Aircraft, Assumed, Magnetometer, Truth
from isogal.seeds import generator
from isogal.sensors.magnetometer import field_vector
from isogal.sensors.trajectory import Trajectory

MAGNETOMETER = "magnetometer"
"""Instrument whose readings a magnetic vehicle changes."""
_POINTS = 200
"""Places of a route at which the main field's direction is computed; it is linear between."""


@dataclass(frozen=True, slots=True, eq=False)
class Vehicle:
    """What a vehicle does to its magnetometers, at the K + 1 ends of the navigator's steps."""

    added: Array
    """(K + 1,) nT, to the total field."""
    vector: Array
    """(R, K + 1, 3) nT, what the vector magnetometer reads in each run, body axes."""


def simulate_vehicle(
    truth: Truth, trajectory: Trajectory, total: Array, runs: Sequence[int]
) -> Vehicle:
    """Return what a vehicle adds to the total field, which is taken to lie along the main field.

    Parameters
    ----------
    truth : Truth
    trajectory : Trajectory
        Of K steps.
    total : (K + 1,) array
        nT, at their ends.
    runs : sequence of int
        They seed the random streams.
    """
    settings = truth.magnetometer
    attitude = matrix(trajectory.attitude)
    direction = np.einsum("kji,kj->ki", attitude, _direction(truth, trajectory))
    body = total[:, None] * direction
    sensed = aircraft_of(settings.aircraft).field_on_board(
        body, np.gradient(body, trajectory.time, axis=0)
    )
    vector = np.broadcast_to(sensed, (len(runs), *sensed.shape))
    if settings.vector_sigma > 0.0:
        vector = vector + settings.vector_sigma * np.stack(
            [
                generator(truth.seed, run, "vector_magnetometer").standard_normal(sensed.shape)
                for run in runs
            ]
        )
    return Vehicle(np.sqrt((sensed**2).sum(axis=-1)) - total, vector)


def specified_compensation(settings: Magnetometer) -> Compensation | None:
    """Return what is said that the vehicle adds to the readings of a magnetometer; None where
    nothing is. Raises InputError where the file cannot be read."""
    if settings.compensation is not None:
        return read_compensation(settings.compensation)
    if settings.aircraft.magnetic:
        return Compensation(aircraft_of(settings.aircraft).coefficients())
    return None


def prior_sigma(settings: Magnetometer) -> Array:
    """Return (18,) the 1-sigma of what is not specified of the coefficients, nT: three times what
    a calibration says of its own, where there is one."""
    specified = specified_compensation(settings)
    sigma = np.full(COUNT, settings.coefficient_sigma)
    if specified is None or not specified.sigma.size:
        return sigma
    return np.minimum(sigma, CALIBRATED_SHARE * specified.sigma[:COUNT])


def assumed_compensation(assumed: Assumed) -> Compensation | None:
    """Return what is taken off the readings as they come: what is specified, or nothing where the
    matcher is to find it; None where nothing is done with them. Raises InputError as
    `specified_compensation`."""
    if assumed.measured_field != "magnetic":
        return None
    specified = specified_compensation(assumed.magnetometer)
    if specified is None and assumed.magnetometer.online:
        return Compensation(np.zeros(COUNT))
    return specified


def aircraft_of(settings: Aircraft) -> MagneticAircraft:
    """Return the vehicle that a section of a scenario describes."""
    induced, eddy = (
        np.array(tensor).reshape(3, 3) for tensor in (settings.induced, settings.eddy)
    )
    return MagneticAircraft(np.array(settings.permanent), induced, eddy)


def _direction(truth: Truth, trajectory: Trajectory) -> Array:
    """Return (K + 1, 3) the main field's direction, north, east, down."""
    index = np.unique(np.linspace(0, len(trajectory), _POINTS).round().astype(int))
    latitude, longitude = np.degrees(trajectory.latitude), np.degrees(trajectory.longitude)
    field = field_vector(
        latitude[index], longitude[index], truth.route.height, truth.magnetometer.epoch
    )
    every = np.arange(len(trajectory) + 1)
    whole = np.stack([np.interp(every, index, part) for part in field.T], axis=-1)
    return whole / np.sqrt((whole**2).sum(axis=-1, keepdims=True))
