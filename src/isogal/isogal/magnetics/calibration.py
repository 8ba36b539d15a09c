"""Coefficients of the Tolles-Lawson model from a calibration flight (docs/magnetometer.md, section
3)."""

from dataclasses import dataclass, field, replace

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.errors import InputError
from isogal.magnetics.band_pass import Band, filtered
from isogal.magnetics.compensation import Compensation
from isogal.magnetics.readings import Readings
from isogal.magnetics.terms import COUNT

_LEAST_SWING = 0.004
"""Least RMS of the direction cosines along the axis in which the field's direction moved least:
rolls and pitches of some degrees give ten times as much, straight flight in turbulence a
twentieth."""
_FIRST_RIDGE, _ROUNDS = 1e-8, 20
"""Where the search for a ridge begins, of the largest eigenvalue of the normal equations; and
steps of it."""
_LEAST_NOISE = 0.05
"""nT: what is left is not taken as smaller, because the model is exact to first order only."""
_LARGEST_SPREAD = 300.0
"""nT: the coefficients' spread is not taken as larger."""
_LONGEST_LAG, _LAG_STEP = 1.0, 0.2
"""s, beyond which no lag is looked for; and between those that are tried first."""
_GAIN = 0.85
"""Of what is left without a lag: less must be left with it. Otherwise the lag is zero."""


@dataclass(frozen=True)
class Settings:
    """How coefficients are learnt."""

    band: Band = field(default_factory=Band)
    ridge: float | None = None
    """Added to the diagonal of the normal equations, whose columns are of the order of 1; holds
    the combinations that a flight does not tell near zero. None = by the evidence; Gnadt et al.
    2022 have 0.025."""
    lag: float | None = None
    """s by which the vector magnetometer is late; None = found out."""
    force: bool = False
    """Whether a flight with too small manoeuvres is taken for what it tells."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """What a calibration flight has shown."""

    compensation: Compensation
    time: Array
    """(N,) s."""
    before: Array
    """(N,) nT, in the band; NaN where it does not hold."""
    after: Array
    """(N,) nT, in the band, less the model."""
    swing: Array
    """(3,) RMS of the direction cosines in the band, along the axes in which they moved most,
    less and least."""
    condition: float
    """Of the filtered terms."""
    determined: float
    """Combinations of coefficients that the flight tells, as many as the trace of the matrix that
    takes true coefficients to those found."""
    used: int
    """Readings that count."""

    @property
    def rms_before(self) -> float:
        """nT, in the band."""
        return float(np.sqrt(np.nanmean(self.before**2)))

    @property
    def rms_after(self) -> float:
        """nT, in the band."""
        return float(np.sqrt(np.nanmean(self.after**2)))


def calibrate(
    readings: Readings,
    known: Array | None = None,
    settings: Settings | None = None,
    reference: bool = False,
) -> Calibration:
    """Return the coefficients that take most of what the vehicle adds off the readings of a
    calibration flight.

    Parameters
    ----------
    readings : Readings
    known : (N,) array, optional
        nT, of the total field what is not the vehicle's: the main field, the daily variation.
    settings : Settings, optional
    reference : bool
        Whether `known` is all of it, anomaly included, so that its level tells the offset.

    Raises
    ------
    InputError
        There are no calibration manoeuvres in the readings, or they are too far apart.
    """
    settings = settings or Settings()
    settings.band.check(readings.interval, readings.where)
    if np.ptp(readings.total[readings.usable]) == 0.0:
        raise InputError(f"{readings.where}: the scalar magnetometer has one reading only; stuck?")
    level = readings.total - (0.0 if known is None else known)
    names = tuple(readings.currents)
    lag = _lag(readings, level, settings) if settings.lag is None else settings.lag
    columns = readings.terms(names, lag)
    y, a, holds = _in_band(readings, level, columns, settings.band)
    swing = _require_manoeuvres(a[holds], readings, settings.force)
    # neighbouring readings in the band are not independent
    share = min(1.0, 2.0 * (settings.band.high - settings.band.low) * readings.interval)
    held, ridge = a[holds], settings.ridge
    if ridge is None:
        ridge = evidence_ridge(held, y[holds], share)
    coefficients, covariance = solve(held, y[holds], ridge)
    values = np.maximum(np.linalg.eigvalsh(held.T @ held), 0.0)
    sigma = np.sqrt(np.diag(covariance) / share)
    found = Compensation(coefficients, names, 0.0, lag, sigma)
    if reference:
        rest = level - columns @ coefficients
        found = replace(found, offset=float(np.median(rest[readings.usable & np.isfinite(rest)])))
    norm = np.sqrt((held**2).sum(axis=0))
    scaled = held[:, norm > 0.0] / norm[norm > 0.0]  # a current may never have flowed
    return Calibration(
        found,
        readings.time,
        np.where(holds, y, np.nan),
        np.where(holds, y - a @ coefficients, np.nan),
        swing,
        float(np.linalg.cond(scaled)),
        float((values / np.maximum(values + ridge, 1e-300)).sum()),
        int(holds.sum()),
    )


def solve(a: Array, y: Array, ridge: float) -> tuple[Array, Array]:
    """Return coefficients (C,) and their covariance (C, C) by least squares with ridge: of columns
    (N, C) and values (N,); the noise is taken to be what is left.

    The covariance is that of coefficients with a prior of (noise / ridge) I: what the readings do
    not tell keeps the prior's."""
    normal = a.T @ a + ridge * np.eye(a.shape[1])
    inverse = np.linalg.inv(normal)
    coefficients = inverse @ (a.T @ y)
    rest = y - a @ coefficients
    variance = max(float(rest @ rest) / max(1, y.size - a.shape[1]), _LEAST_NOISE**2)
    return coefficients, variance * inverse


def evidence_ridge(a: Array, y: Array, share: float = 1.0) -> float:
    """Return the ridge under which the readings are most likely, if all coefficients are drawn
    from one normal distribution (MacKay 1992, Neural Computation 4:415, section 4), within what
    can be.

    Parameters
    ----------
    a, y : (N, C) and (N,) array
    share : float
        Of the readings that are independent.
    """
    values, axes = np.linalg.eigh(a.T @ a)
    values, along = np.maximum(values, 0.0), axes.T @ (a.T @ y)
    ridge = _FIRST_RIDGE * values[-1]
    for _ in range(_ROUNDS):
        coefficients = along / (values + ridge)
        determined = float((values / (values + ridge)).sum())
        rest = float(y @ y - coefficients @ (2.0 * along - values * coefficients))
        noise = max(rest / y.size, _LEAST_NOISE**2) / share
        spread = min(float(coefficients @ coefficients) / determined, _LARGEST_SPREAD**2)
        ridge = noise / spread
    return ridge


def _in_band(
    readings: Readings, level: Array, columns: Array, band: Band
) -> tuple[Array, Array, Booleans]:
    """Return (N,) level and (N, C) columns in the band, and where both hold."""
    whole = np.column_stack([level, columns])
    usable = readings.usable & np.isfinite(whole).all(axis=1)
    found, holds = filtered(readings.time, np.where(usable[:, None], whole, 0.0), usable, band)
    if not holds.any():
        raise InputError(
            f"{readings.where}: no stretch of even readings without gaps is longer than"
            f" {4.0 * band.settling:g} s"
        )
    return found[:, 0], found[:, 1:], holds


def _lag(readings: Readings, level: Array, settings: Settings) -> float:
    """Return by how much the vector magnetometer is late, s: the lag with which a fit leaves least
    (docs/magnetometer.md, section 3.3); zero if that is hardly less than without.

    A cross-correlation with a model that is fitted once does not see it, since a short lag looks
    like eddy currents. So the model is fitted anew at each shift."""
    from scipy.optimize import minimize_scalar

    def left(lag: float) -> float:
        columns = readings.terms(tuple(readings.currents), lag)
        y, a, holds = _in_band(readings, level, columns, settings.band)
        y, a = y[holds], a[holds]
        found, _ = solve(a, y, settings.ridge or evidence_ridge(a, y))
        return float(np.sqrt(np.mean((y - a @ found) ** 2)))

    tried = np.arange(-_LONGEST_LAG, _LONGEST_LAG + 0.5 * _LAG_STEP, _LAG_STEP)
    best = min(tried.tolist(), key=left)
    bounds = best - _LAG_STEP, best + _LAG_STEP
    found = minimize_scalar(left, bounds=bounds, method="bounded", options={"xatol": 1e-3})
    return float(found.x) if found.fun < _GAIN * left(0.0) else 0.0


def _require_manoeuvres(a: Array, readings: Readings, force: bool) -> Array:
    """Return (3,) by how much the field's direction moved in the band; raises InputError where
    that is not enough and not forced."""
    if len(a) < 4 * COUNT:
        raise InputError(f"{readings.where}: {len(a)} readings that count are too few")
    swing = np.linalg.svd(a[:, :3], compute_uv=False) / np.sqrt(len(a))
    if swing[2] < _LEAST_SWING and not force:
        what = "manoeuvres on one heading only, or about one axis"
        if swing[1] < _LEAST_SWING:
            what = "no calibration manoeuvres"
        moved = " / ".join(f"{np.degrees(one):.2f}" for one in swing)
        raise InputError(
            f"{readings.where}: {what}: the field's direction moved by {moved} deg (RMS, three"
            f" axes); at least {np.degrees(_LEAST_SWING):.2f} is needed: rolls, pitches and yaws"
            " of 5 to 10 deg on four headings (--force takes what there is)"
        )
    return swing
