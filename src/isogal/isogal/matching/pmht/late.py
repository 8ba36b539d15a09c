"""Readings that tell of earlier: compiled, of one hypothesis (docs/mathematics.md, section 5.4).

An instrument that is late by tau gives what it sensed tau ago. One with a first-order low-pass
filter of the time constant T gives y, with T dy/dt = s - y of what it senses, s: y is a state of
the hypothesis, which takes in s from reading to reading. Both tau and the error of T are states.
"""

import math
from typing import NamedTuple

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.maps.interpolation import Grid, value_and_gradient
from isogal.matching.pmht.rows import PAST
from isogal.matching.pmht.states import DELAY, FILTER, FILTER_ERROR, UNKNOWN

SHORTEST = 0.1
"""Of a model's time constant, the least that is believed while its error is looked for."""


class Late(NamedTuple):
    """By what a model's readings are late."""

    value: int
    """Which of its states is the value of a filter; -1 = there is no filter."""
    error: int
    """Which is the error of its time constant; -1 = there is none."""
    delay: int
    """Which is the delay; -1 = there is none."""
    lag: float
    """The time constant, s."""


@kernel(error_model="numpy")
def late_by(used: Integers, c: int, states: int, lag: float, past: Array) -> Late:
    """Return by what the readings of a model of c of so many states, `used`, are late; of
    readings whose `past` is not known they are not."""
    value, error, delay, unknown = -1, -1, -1, states - len(UNKNOWN)
    for i in range(c if past.shape[1] > 2 else 0):
        if used[i] == unknown + FILTER:
            value = i
        elif used[i] == unknown + FILTER_ERROR:
            error = i
        elif used[i] == unknown + DELAY:
            delay = i
    return Late(value, error, delay, lag)


@kernel(error_model="numpy")
def earlier(past: Array, t: int, age: float) -> tuple[float, float, float, float, float, float]:
    """Return what `Rows.past` (n, Q, 3) says of row t at an age (s), and how that changes per
    s."""
    i = min(max(int(age / PAST), 0), past.shape[1] - 2)
    u = age / PAST - i
    lat, lon, less = past[t, i, 0], past[t, i, 1], past[t, i, 2]
    by_lat, by_lon = past[t, i + 1, 0] - lat, past[t, i + 1, 1] - lon
    by_less = past[t, i + 1, 2] - less
    return (
        lat + u * by_lat, lon + u * by_lon, less + u * by_less,
        by_lat / PAST, by_lon / PAST, by_less / PAST,
    )  # fmt: skip


@kernel(error_model="numpy")
def sensed(
    grid: Grid, past: Array, t: int, lat: float, lon: float, channel: int, age: float
) -> tuple[float, float, float, float]:
    """Return what was sensed an age (s) before row t, whose place is given (rad), as if reduced
    at the row, and its derivatives by that place (per rad) and by the age (per s)."""
    to_lat, to_lon, less, lat_by, lon_by, less_by = earlier(past, t, age)
    value, by_lat, by_lon = value_and_gradient(grid, lat + to_lat, lon + to_lon, channel)
    return value + less, by_lat, by_lon, by_lat * lat_by + by_lon * lon_by + less_by


@kernel(error_model="numpy")
def taken_in(
    grid: Grid,
    past: Array,
    t: int,
    lat: float,
    lon: float,
    channel: int,
    late: Late,
    at: Array,
    elapsed: float,
) -> tuple[float, float, float, float]:
    """Return `sensed` of a hypothesis of states `at`: of its delay, or what its filter takes in
    over `elapsed` s, as the mean at two ages of the first two moments."""
    delay = at[late.delay] if late.delay >= 0 else 0.0
    if late.value < 0 or not elapsed > 0.0:
        return sensed(grid, past, t, lat, lon, channel, delay)
    _, age, spread = shares(believed(late, at), elapsed)
    age += delay
    v, a, b, s = sensed(grid, past, t, lat, lon, channel, age - spread)
    v2, a2, b2, s2 = sensed(grid, past, t, lat, lon, channel, age + spread)
    return 0.5 * (v + v2), 0.5 * (a + a2), 0.5 * (b + b2), 0.5 * (s + s2)


@kernel(error_model="numpy")
def believed(late: Late, at: Array) -> float:
    """Return a filter's time constant, s, of a hypothesis of states `at`."""
    return max(late.lag + (at[late.error] if late.error >= 0 else 0.0), SHORTEST * late.lag)


@kernel(error_model="numpy")
def shares(lag: float, elapsed: float) -> tuple[float, float, float]:
    """Return what of a filter's value is left after some time, and mean and standard deviation of
    the age of what it has taken in since; all s."""
    left = math.exp(-elapsed / lag)
    gone = elapsed * left / (1.0 - left)
    age = lag - gone
    variance = 2.0 * lag**2 - gone * (elapsed + 2.0 * lag) - age**2
    return left, age, math.sqrt(max(variance, 0.0))  # rounding, after microseconds


@kernel(error_model="numpy")
def low_passed(
    x: Array,
    P: Array,
    late: Late,
    at: Array,
    elapsed: float,
    g: float,
    G: Array,
    by_age: float,
    c: int,
    work: Array,
) -> None:
    """Let a filter take in g + G x for `elapsed` s, in place: mean x and covariance P of c
    states, linear about `at`; `by_age` as in `sensed`."""
    y, e, lag = late.value, max(late.error, 0), believed(late, at)
    left = math.exp(-elapsed / lag)
    new, more = 1.0 - left, left * elapsed / lag**2  # of `left`, per s of the time constant
    for i in range(c):
        g += G[i] * x[i]
    by_lag = more * (x[y] - g) + by_age * (new - elapsed * more / new) if late.error >= 0 else 0.0
    x[y] = left * x[y] + new * g + by_lag * (x[e] - at[e])
    for j in range(c):
        work[j] = left * P[y, j] + by_lag * P[e, j]
        for i in range(c):
            work[j] += new * G[i] * P[i, j]
    variance = left * work[y] + by_lag * work[e]
    for j in range(c):
        variance += new * G[j] * work[j]
    for j in range(c):
        P[y, j] = work[j]
        P[j, y] = work[j]
    P[y, y] = variance
