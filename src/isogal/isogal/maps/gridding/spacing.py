"""How far apart the nodes of a map are to be: as near as its interpolation asks for."""

import math
from collections.abc import Callable

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.maps.gridding.kriging import Kriging
from isogal.maps.gridding.survey import Survey
from isogal.seeds import generator

_NEIGHBOURS, _SAMPLE = 200, 2000
_PLACES = 40
_SHARES = (2.0, 1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125)
"""Of the gap between lines: spacings that are tried."""
_MOST_ADDED = 0.1
"""Of the variance of the error that a reading would show, that interpolation adds: 5 % of its
RMS."""
_NEXT_TO = 0.01
"""Of the gap, next to readings."""
_WEIGHTS = np.array([-1.0, 9.0, 9.0, -1.0]) / 16.0
"""Of four nodes in a row, for the middle between them (Keys 1981, eq. 15)."""


def gap_of(survey: Survey) -> float:
    """Return how far apart lines are that lie side by side, m; of stations, twice their distance.

    In a circle of radius r lie n readings; if the next on a line is at a distance a, lines are
    π r² / (n a) apart. The median over the survey is taken.
    """
    from scipy.spatial import cKDTree

    places = survey.places[:, :2]
    count = min(_NEIGHBOURS, len(places) // 2)
    distance = cKDTree(places).query(places[:: max(len(places) // _SAMPLE, 1)], [2, count])[0]
    along = max(float(np.median(distance[:, 0])), 1.0)
    return math.pi * float(np.median(distance[:, 1])) ** 2 / (count * along)


def spacing_of(kriging: Kriging, sigma: Callable[[Array, Array], Array], gap: float) -> float:
    """Return the widest spacing (m), of some shares of a gap, at which bicubic interpolation
    between nodes adds little to the error of a map, both next to readings and between them;
    `sigma`: of the map, from places and the variance that kriging leaves there."""
    random = generator(0, 0, "gridding spacing")
    readings = kriging.readings.places
    nodes = np.arange(-1.5, 2.0)
    stencil = np.stack([*np.meshgrid(nodes, nodes), np.zeros((4, 4))], axis=-1).reshape(-1, 3)
    weight = np.outer(_WEIGHTS, _WEIGHTS).ravel()
    around = np.concatenate([np.zeros((1, 3)), *(share * gap * stencil for share in _SHARES)])
    enough: Booleans = np.ones(len(_SHARES), dtype=np.bool_)
    for reach in (_NEXT_TO * gap, 0.5 * gap):
        added, total = np.zeros(len(_SHARES)), 0.0
        for row in random.choice(len(readings), min(_PLACES, len(readings)), replace=False):
            place = readings[row] + np.append(random.uniform(-reach, reach, 2), 0.0)
            mean, left = kriging.together(place + around)
            total += float(sigma(place[None], left[:1, 0].clip(0.0))[0]) ** 2
            added += (mean[1:].reshape(len(_SHARES), -1) @ weight - mean[0]) ** 2
        enough &= added <= _MOST_ADDED * total
    return gap * _SHARES[int(np.argmax(enough)) if enough.any() else -1]
