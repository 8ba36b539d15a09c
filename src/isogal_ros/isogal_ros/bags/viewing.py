"""A recording as `isogal view` shows it."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from isogal.errors import InputError
from isogal.evaluation.run_report import subtitle_of
from isogal.evaluation.view.record import AidUse, Event, ViewedRun
from isogal.fields.scenario_map import maps_for_scenario
from isogal.maps.several import first_map
from isogal.scenario import Scenario
from isogal.sensors.trajectory import build_trajectory
from isogal_ros.bags.collect import Collector, Said
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.record import record_of
from isogal_ros.bags.remapping import NOTHING_SAID, Foreign
from isogal_ros.messages.stamps import to_seconds

if TYPE_CHECKING:
    from isogal.maps.channels import RouteMap


def open_bag(
    bag: Path,
    scenario: Scenario | None = None,
    foreign: Foreign = NOTHING_SAID,
) -> "tuple[ViewedRun, RouteMap]":
    """Return what a recording holds and the map that it was matched against.

    Parameters
    ----------
    scenario : Scenario, optional
        None = the bag's own.
    foreign : Foreign
        How it is as the graph's own.

    Raises
    ------
    InputError
        The bag cannot be read, does not say which scenario it is of, or has no readings where the
        navigator was.
    """
    reader = BagReader.foreign(bag, foreign)
    scenario = scenario or reader.scenario()
    if scenario is None:
        raise InputError(
            f"{bag}: does not say which scenario it is of, so its map is not known; say it with"
            " --scenario"
        )
    collector = Collector(scenario)
    collector.take_bag(reader)
    field_map = first_map(maps_for_scenario(scenario, build_trajectory(scenario)))
    viewed = viewed_run(collector, field_map, _title(bag))
    if viewed is None:
        raise InputError(f"{bag}: has no reading of which nav/fix says where it was taken")
    return viewed, field_map


def viewed_run(
    collector: Collector, field_map: "RouteMap", title: str, subtitle: str = ""
) -> ViewedRun | None:
    """Return what was collected so far; None before the first scan.

    Where nobody recorded the truth, as on a real voyage, the record's positions are those that the
    navigator believes in.

    Parameters
    ----------
    field_map : RouteMap
        That it was matched against.
    title, subtitle : str
        Shown; an empty subtitle says what was run.
    """
    is_true = bool(collector.truth)
    if not is_true:
        collector = copy(collector)
        collector.truth = collector.last_nav
    runs = record_of(collector, field_map)
    if runs is None:
        return None
    events = [Event(to_seconds(one.ns), one.level, one.name, one.text) for one in collector.said]
    subtitle = subtitle or subtitle_of(runs, collector.scenario)
    aids = uses_of(collector.aids)
    return ViewedRun(runs, collector.scenario, title, subtitle, events, is_true, aids)


def uses_of(said: Sequence[Said]) -> list[AidUse]:
    """Return when each aid was used and when not, of what was said of them one after the other: a
    use goes on until something else is said, whatever its numbers."""
    found: list[AidUse] = []
    last: dict[str, int] = {}
    for one in said:
        time, used = to_seconds(one.ns), one.level == "OK"
        row = last.get(one.name)
        if row is not None:
            before = found[row]
            found[row] = replace(before, end=time)
            if before.used == used and _words(before.text) == _words(one.text):
                continue
        last[one.name] = len(found)
        found.append(AidUse(one.name, time, time, used, one.text))
    return found


def _words(text: str) -> str:
    """Return a text without its numbers."""
    return "".join(character for character in text if not character.isdigit())


def _title(bag: Path) -> str:
    """Return the name of the run's folder, or of the bag."""
    folder = bag.resolve()
    return folder.parent.name if folder.name == "bag" else folder.name
