"""Examples of the map lookup function in one and in two dimensions (paper figs. 54a, 54)."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.matching.paper.map_lookup import Window, lattice_spacing, lookup
from isogal.matching.paper.pda import association_weights, candidate_variance, combine
from isogal.paper.cases import Plan, Setting
from isogal.paper.published import (
    FIGURE_54_CANDIDATES,
    FIGURE_54_READING_SIGMA,
    FIGURE_54_SIDE,
    LOW,
)
from isogal.seeds import generator

PROFILE_WINDOW = 4e3
"""m, half width of the 1-D search window."""
_REACH = 8e3
"""m, half length of the profile."""
_PLACES = 200
_SPACING = 250.0
"""m, of the places that are candidates in the window."""


@dataclass(frozen=True, slots=True, eq=False)
class ProfileExample:
    """Map values along a line to the east, and where a reading may come from."""

    offset: Array
    """m east of the true place."""
    profile: Array
    centre: float
    """m, prior."""
    reading: float
    candidates: Array
    """m, within the window."""
    ambiguous: float
    """Share of places along the track whose reading has more than one candidate in the window."""


def profile_example(plan: Plan) -> ProfileExample:
    """Look readings up along the track; the example is the first place with three candidates, or
    with a number as near to three as there is."""
    trajectory, field_map = plan.trajectory(Setting()), plan.field_map(Setting())
    offset = np.linspace(-_REACH, _REACH, 1601)
    centre = 0.3 * PROFILE_WINDOW
    error = LOW["gravity"] * generator(0, 0, "fig-54a").standard_normal()
    examples = []
    for place in range(0, len(trajectory), max(1, len(trajectory) // _PLACES)):
        latitude, longitude = trajectory.latitude[place], trajectory.longitude[place]
        east = longitude + offset / float(metres_per_radian(latitude)[1])
        profile = field_map.value(latitude, east)
        if np.isfinite(profile).all():
            reading = float(np.interp(0.0, offset, profile)) + error
            there = _crossings(offset, profile - reading)
            examples.append((profile, reading, there[np.abs(there - centre) <= PROFILE_WINDOW]))
    ambiguous = float(np.mean([len(there) > 1 for _, _, there in examples]))
    profile, reading, candidates = min(examples, key=lambda example: abs(len(example[2]) - 3))
    return ProfileExample(offset, profile, centre, reading, candidates, ambiguous)


def _crossings(x: Array, y: Array) -> Array:
    """Return where y changes its sign, by linear interpolation."""
    at = np.flatnonzero((y[1:] > 0.0) != (y[:-1] > 0.0))
    return x[at] - y[at] / (y[at + 1] - y[at]) * (x[at + 1] - x[at])


@dataclass(frozen=True, slots=True, eq=False)
class WindowExample:
    """A search window about a wrong prior; metres north and east of its centre."""

    truth: Array
    candidates: Array
    weight: Array
    combined: Array
    """PDA solution."""
    reading: float
    latitude: float
    longitude: float


def window_example(plan: Plan) -> WindowExample:
    """Look a reading up a third of the way along the track, in a window of 5 x 5 km with 50
    candidates about a prior that is some hundred metres off (paper eqs. s2-01, s3-01 to
    s3-021)."""
    trajectory, field_map = plan.trajectory(Setting()), plan.field_map(Setting())
    place = len(trajectory) // 3
    prior = float(trajectory.latitude[place]), float(trajectory.longitude[place])
    random = generator(0, 0, "fig-54")
    north, east = (float(m) for m in metres_per_radian(prior[0]))
    truth = 0.12 * FIGURE_54_SIDE * random.standard_normal(2)
    sigma = FIGURE_54_READING_SIGMA
    value = float(field_map.value(prior[0] + truth[0] / north, prior[1] + truth[1] / east))
    reading = value + sigma * random.standard_normal()
    half, grid, count = 0.5 * FIGURE_54_SIDE, field_map.grid, FIGURE_54_CANDIDATES
    window = Window(np.zeros((2, 2)), np.full(2, half))
    offset, gradient = lookup(
        grid, prior, (north, east), window, reading, (0.0, 0.0), _SPACING, count
    )
    step = lattice_spacing(grid, (north, east), _SPACING)
    variance = candidate_variance(sigma, gradient, step, half**2)
    # as wide as the window's own prior, as eq. s3-01 weighs by distance to the centre
    weight = association_weights(offset, np.zeros(2), variance + (half / 3.0) ** 2)
    combined, _ = combine(offset, weight, variance)
    return WindowExample(truth, offset, weight, combined, float(reading), *prior)
