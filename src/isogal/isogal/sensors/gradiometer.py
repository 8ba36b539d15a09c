"""The gradiometer: components of the gravity gradient tensor at the vehicle, several numbers at
each scan (docs/mathematics.md, section 2.7).

It measures the gradient of gravity in axes north, east, down, at the vehicle's height. The
reduction takes off the normal gradient at the navigator's own latitude and height, which leaves
the gradient of the disturbing potential, as in the maps. The normal gradient changes by 0.003 E
per kilometre of latitude and 0.001 E per metre of height, so the effect of the navigator's error
on the reduction is neglected.

The platform is to be level and to point north (how well: `gradiometer_errors`), and the instrument
to correct for the platform's own rotation (Jekeli 1988, The gravity gradiometer survey system, EOS
69)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.earth.gravity import normal_gradient
from isogal.scenario import TENSOR_COMPONENTS, Gradiometer, Truth
from isogal.seeds import generator
from isogal.sensors.gradiometer_errors import EOTVOS, places_in_tensor
from isogal.sensors.reduction import State


def noise_covariance(settings: Gradiometer) -> Array:
    """Return the covariance (C, C) of a reading's white noise, 1/s⁴."""
    if settings.covariance_eotvos is not None:
        return np.array(settings.covariance_eotvos) * EOTVOS**2
    return np.eye(len(settings.components)) * (settings.sigma_eotvos * EOTVOS) ** 2


def draw_noise(truth: Truth, run: int, scans: int) -> Array:
    """Return the noise (scans, C) of one run, 1/s²; all components of an outlier are outliers, see
    `scenario.Gravimeter`."""
    root = np.linalg.cholesky(noise_covariance(truth.gradiometer))
    white = generator(truth.seed, run, "gradiometer_noise").standard_normal((scans, len(root)))
    settings = truth.gravimeter
    if settings.outlier_fraction > 0.0:
        random = generator(truth.seed, run, "gradiometer_outliers")
        hit = random.random((scans, 1)) < settings.outlier_fraction
        white = white + hit * settings.outlier_sigma * random.standard_normal(white.shape)
    return white @ root.T


class GradientReduction:
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

    def report(self, raw: ArrayLike) -> Array:
        """Return it as it is."""
        return np.asarray(raw, dtype=float)

    def reduce(self, raw: ArrayLike, at: State) -> Array:
        """Return the measured gradient less the normal one."""
        return np.asarray(raw) - self._normal(at)

    def jacobian(self, at: State) -> Array:
        """Return zeros: the effect of the navigator's error is neglected (see the module)."""
        return np.zeros((*np.shape(at.latitude), 4))

    def height_slope(self, at: State) -> Array:
        """Return zeros: as for `jacobian`."""
        return np.zeros(np.shape(at.latitude))
