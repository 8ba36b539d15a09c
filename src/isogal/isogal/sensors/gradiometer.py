"""The gradiometer: components of the gravity gradient tensor at the vehicle, several numbers at
each scan (docs/mathematics.md, section 2.7).

It measures the gradient of gravity in axes north, east, down, at the vehicle's height. The
reduction takes off the normal gradient at the navigator's own latitude and height, which leaves
the gradient of the disturbing potential, as in the maps. The normal gradient changes by 0.003 E
per kilometre of latitude and 0.001 E per metre of height, so the effect of the navigator's error
on the reduction is neglected.

The platform is to be level and to point north (how well: `tilt_errors`), and the instrument
to correct for the platform's own rotation (Jekeli 1988, The gravity gradiometer survey system, EOS
69)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.earth.gravity import normal_gradient
from isogal.inertial.rotations import cross_matrix, from_rotation_vector, matrix
from isogal.scenario import TENSOR_COMPONENTS, Gradiometer, Gravimeter
from isogal.sensors.noise import Noise, RunScans
from isogal.sensors.reduction import Reduction, State

EOTVOS = 1e-9
"""1/s² in 1 E."""
_AXES = {"n": 0, "e": 1, "d": 2}
_TRACE = (0, 1, 2)


def places_in_tensor(components: Sequence[str]) -> tuple[list[int], list[int]]:
    """Return rows and columns (C,) of components in the tensor."""
    return [_AXES[name[0]] for name in components], [_AXES[name[1]] for name in components]


class GradientReduction(Reduction):
    """From the measured gravity gradient (..., C), 1/s², to that of the disturbing potential.

    Parameters
    ----------
    components : sequence of str
        C of `scenario.TENSOR_COMPONENTS`.
    """

    def __init__(self, components: Sequence[str] = TENSOR_COMPONENTS) -> None:
        self._rows, self._columns = places_in_tensor(components)

    def _normal(self, at: State) -> Array:
        return normal_gradient(at.latitude, at.height)[..., self._rows, self._columns]

    def raw(self, value: ArrayLike, at: State) -> Array:
        """Return the measured gradient where that of the disturbing potential is given."""
        return np.asarray(value) + self._normal(at)

    def reduce(self, raw: ArrayLike, at: State) -> Array:
        """Return the measured gradient less the normal one."""
        return np.asarray(raw) - self._normal(at)


def noise_covariance(settings: Gradiometer) -> Array:
    """Return the covariance (C, C) of a reading's white noise, 1/s⁴."""
    if settings.covariance_eotvos is not None:
        return np.array(settings.covariance_eotvos) * EOTVOS**2
    return np.eye(len(settings.components)) * (settings.sigma_eotvos * EOTVOS) ** 2


def noise_of(settings: Gradiometer, outliers: Gravimeter) -> Noise:
    """Return the random errors of the components, 1/s²; all components of an outlier are outliers,
    whose share and size the section `gravimeter` says."""
    return Noise(
        "gradiometer",
        np.asarray(np.linalg.cholesky(noise_covariance(settings)), dtype=np.float64),
        outliers.outlier_fraction,
        outliers.outlier_sigma,
        bias=settings.bias_eotvos * EOTVOS,
        walk=settings.bias_walk_eotvos * EOTVOS,
    )


def tilt_errors(settings: Gradiometer, scans: RunScans, sensed: Array) -> Array:
    """Return (scans, C) what a run's tilted platform adds to what a level instrument senses
    (scans, C), 1/s², normal gradient included; `settings` is what is true of it."""
    if settings.platform_tilt == 0.0:
        return np.zeros(sensed.shape)
    tilt = scans.tilts("gradiometer", settings.platform_tilt, settings.platform_time, 3)
    trajectory, index = scans.trajectory, scans.index
    latitude, height = trajectory.latitude[index], trajectory.height[index]
    tensor = _whole(settings.components, sensed, normal_gradient(latitude, height))
    return np.asarray(tilted(tensor, tilt.T)[..., *places_in_tensor(settings.components)] - sensed)


def tilted(tensor: Array, tilt: Array) -> Array:
    """Return the tensor (..., 3, 3) in axes that are turned by rotation vectors (..., 3), rad."""
    # of a vector's components from the level axes to the turned ones
    back = [from_rotation_vector(*one) for one in -tilt.reshape(-1, 3)]
    turn = matrix(np.reshape(back, (*tilt.shape[:-1], 4)))
    return np.asarray(turn @ tensor @ turn.swapaxes(-1, -2))


def tilt_effect(components: Sequence[str], latitude: ArrayLike) -> Array:
    """Return (..., C, 2) by how much components are larger per rad of tilt about north and about
    east, 1/s²: to first order, of the normal gradient alone, of which the field's own is at most a
    few per cent."""
    normal = normal_gradient(latitude)[..., None, :, :]
    cross = cross_matrix(np.eye(3)[:2])
    change = normal @ cross - cross @ normal
    rows, columns = places_in_tensor(components)
    return np.asarray(np.moveaxis(change[..., rows, columns], -2, -1))


def _whole(components: Sequence[str], sensed: Array, normal: Array) -> Array:
    """Return (scans, 3, 3) the tensor of which components (scans, C) are known: one more follows
    by the trace, any other is taken as the normal gradient's (scans, 3, 3)."""
    tensor = normal.copy()
    rows, columns = places_in_tensor(components)
    tensor[:, rows, columns] = sensed
    tensor[:, columns, rows] = sensed
    unknown = [k for k in _TRACE if (k, k) not in zip(rows, columns, strict=True)]
    if len(unknown) == 1:
        k = unknown[0]
        trace = np.trace(normal, axis1=1, axis2=2)
        tensor[:, k, k] += trace - np.trace(tensor, axis1=1, axis2=2)
    return tensor
