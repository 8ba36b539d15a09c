"""A recording as `isogal view` shows it."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from isogal.arrays import Array
from isogal.cli.errors import note
from isogal.errors import InputError
from isogal.evaluation.run_report import subtitle_of
from isogal.evaluation.view.record import AidUse, Event, ViewedRun
from isogal.fields.scenario_map import maps_for_scenario
from isogal.maps.field_map import FieldMap
from isogal.maps.quantities import QUANTITIES
from isogal.maps.several import first_map
from isogal.scenario import Scenario
from isogal.sensors.trajectory import build_trajectory
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.record import Collector, Places, record_of
from isogal_ros.nodes.health import without_numbers

if TYPE_CHECKING:
    from isogal.maps.channels import RouteMap

_MARGIN = 1e-3
"""rad, 6 km: within the page's own margin (`isogal.evaluation.view.background`), so that the
corner with the value is on the page."""
_ROUND = np.radians(359.0)
"""rad: a map has no longitude twice."""


def open_bag(
    bag: Path,
    scenario: Scenario | None = None,
    remap: Sequence[str] | None = None,
    drivers: Sequence[str] | None = None,
) -> "tuple[ViewedRun, RouteMap]":
    """Return what a recording holds and the map that it was matched against, an empty one where
    nobody says which.

    Parameters
    ----------
    scenario : Scenario, optional
        None = the bag's own; where it has none, there is no map.
    remap, drivers : sequence of str, optional
        How it is as the graph's own (`BagReader`).

    Raises
    ------
    InputError
        The bag or its map cannot be read, or it has no two positions of the navigator.
    """
    reader = BagReader(bag, remap or (), drivers or ())
    scenario = scenario or reader.scenario()
    collector = Collector(scenario or Scenario())
    collector.take_bag(reader)
    if reader.cut is not None:
        note(f"{bag}: not read to its end: {reader.cut}")
    if len(collector.last_nav) < 2:
        raise InputError(
            f"{bag}: has no two messages on {topics.NAV_FIX.name}, where the navigator was; those"
            f" of another navigator or receiver are taken by --remap /TOPIC:={topics.NAV_FIX.name}"
        )
    if scenario is None:
        field_map: RouteMap = _no_map(Places(collector.last_nav).at(sorted(collector.last_nav)))
    else:
        field_map = first_map(maps_for_scenario(scenario, build_trajectory(scenario)))
    folder = bag.resolve()
    title = folder.parent.name if folder.name == "bag" else folder.name
    viewed = viewed_run(collector, field_map, title)
    if viewed is None:
        raise InputError(f"{bag}: has no reading of which nav/fix says where it was taken")
    return replace(viewed, has_map=scenario is not None), field_map


def _no_map(places: Array) -> FieldMap:
    """Return a map without values at places (n, 2), rad; a map has one somewhere."""
    places = np.unwrap(places, axis=0)  # also across 180 degrees
    low, high = places.min(axis=0) - _MARGIN, places.max(axis=0) + _MARGIN
    pole = 0.5 * np.pi
    latitude = np.linspace(max(low[0], -pole), min(high[0], pole), 8)
    longitude = np.linspace(low[1], min(high[1], low[1] + _ROUND), 8)
    values, unit = np.full((8, 8), np.nan), QUANTITIES["gravity"].unit
    values[0, 0] = QUANTITIES["gravity"].lowest
    return FieldMap(latitude, longitude, values, unit, "gravity", provenance="no map")


def viewed_run(collector: Collector, field_map: "RouteMap", title: str) -> ViewedRun | None:
    """Return what was collected so far, by the map that it was matched against; None before the
    first scan.

    Where nobody recorded the truth, as on a real voyage, the record's positions are those that the
    navigator believes in."""
    is_true = bool(collector.truth)
    if not is_true:
        collector = copy(collector)
        collector.truth = collector.last_nav
    runs = record_of(collector, field_map)
    if runs is None:
        return None
    scenario, aids = collector.scenario, uses_of(collector.aids)
    subtitle = subtitle_of(runs, scenario)
    return ViewedRun(runs, scenario, title, subtitle, collector.said, is_true, aids)


def uses_of(said: Sequence[Event]) -> list[AidUse]:
    """Return when each aid was used and when not, of what was said of them one after the other: a
    use goes on until something else is said, whatever its numbers."""
    found: list[AidUse] = []
    last: dict[str, int] = {}
    for one in said:
        time, used = one.time, one.level == "OK"
        row = last.get(one.source)
        if row is not None:
            before = found[row]
            found[row] = replace(before, end=time)
            if before.used == used and without_numbers(before.text) == without_numbers(one.text):
                continue
        last[one.source] = len(found)
        found.append(AidUse(one.source, time, time, used, one.text))
    return found
