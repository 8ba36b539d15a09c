"""Readings that are wrong: those as far off from their neighbours as blunders are, are set aside
before anything is learnt, and used where what the others predict does not contradict them.

With a few such readings among hundreds the field would seem to be noise, in which nobody could
tell them any more, and the map would show them."""

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.maps.gridding.survey import Survey

FAR = 6.0
"""1-sigmas: of Gaussian errors one in five hundred million is further off."""
_BESIDE, _SPIKE = 8, 20.0
"""Readings next to one, and its distance from their median, in units of how far they are from it
themselves (median; or as usual in the survey), from which on it is set aside: 24 of 96,000
readings of nine measured surveys, 19 of them of a ship's magnetics; with 12 it is 42."""
Named = dict[str, float | str | bool]
"""What is said of a reading: where it is, of which line and time, how far off, whether used."""


def spikes(survey: Survey) -> Booleans:
    """Return which readings (N,) are to be set aside: none that has another such beside it, as
    both poles of a body at a small depth are."""
    from scipy.spatial import cKDTree

    value, places = survey.value, survey.places[:, :2]
    if len(value) <= _BESIDE:
        return np.zeros(len(value), np.bool_)
    near = cKDTree(places).query(places, _BESIDE + 1)[1][:, 1:]
    middle = np.median(value[near], axis=1)
    spread = np.median(np.abs(value[near] - middle[:, None]), axis=1)
    spread = np.maximum(spread, np.median(spread))
    off = (spread > 0.0) & (np.abs(value - middle) > _SPIKE * spread)
    return np.asarray(off & ~off[near].any(axis=1))


def named(
    survey: Survey, rows: Integers, predicted: Array, sigmas: Array, *, used: bool
) -> list[Named]:
    """Return what is said of readings `rows` (n,) that are so many 1-sigmas (n,) off what the
    others predict (n,), the worst first."""
    found = list[Named]()
    for k in np.argsort(-sigmas).tolist():
        row = int(rows[k])
        place = np.degrees([survey.latitude[row], survey.longitude[row]]).tolist()
        one: Named = {"latitude": place[0], "longitude": place[1]}
        if survey.line is not None:
            number = int(survey.line[row])
            name = survey.line_names.get(number, "")
            one["line"] = number if name in ("", str(number)) else name
        if survey.time is not None:
            one["time"] = float(survey.time[row])
        off = float(survey.value[row] - predicted[k])
        found.append(one | {"off": off, "sigmas": float(sigmas[k]), "used": used})
    return found
