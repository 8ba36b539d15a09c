"""A recorded voyage, smoothed: its sensor messages are played to fresh nodes as by a replay, whose
filter keeps its whole history."""

from contextlib import suppress
from pathlib import Path

import numpy as np
from rclpy.serialization import deserialize_message

from isogal.afterwards import Sensed, smoothed_voyage
from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.errors import InputError
from isogal.evaluation.consistency import nees_per_axis
from isogal.fields.scenario_map import maps_for_scenario
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.smoothed_track import SmoothedTrack, write_smoothed
from isogal.maps.several import each_map
from isogal.mcap_files import parts
from isogal.scenario import Scenario
from isogal.sensors.trajectory import build_trajectory
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader, topic_of
from isogal_ros.bags.record import Collector, Places, wanted_messages
from isogal_ros.bags.writer import BagWriter, scenario_text
from isogal_ros.graph.replay import Replay
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import map_frame
from isogal_ros.messages.odometry import empty_odometry, fill_state
from isogal_ros.messages.prepared import peek_ns
from isogal_ros.messages.stamps import among, to_seconds

WHOLE = {"horizon": 1e8}
"""Parameters of a filter whose history goes back three years, s."""
Figures = dict[str, dict[str, float]]
"""Of the errors, smoothed and at the time: `position_error_rms`, m, and `nees_per_axis`."""


def smoothed_files(
    reader: BagReader, played: Replay, out: Path, interval: float
) -> tuple[int, Figures, list[Path]]:
    """Smooth a recorded voyage and write it into a folder; return how many states there are, the
    figures of their errors where the truth is recorded, and the files.

    Parameters
    ----------
    reader : BagReader
    played : Replay
        Of the bag, to a filter which keeps its whole history (`WHOLE`).
    out : Path
    interval : float
        s between the rows of the files, at least; the bag has every state.

    Raises
    ------
    InputError
        The filter has begun nowhere in the bag.
    """
    navigator = played.filter
    if navigator is None:
        raise InputError(f"{reader.path}: the filter has no start: {'; '.join(played.failures)}")
    stamps, rates = navigator.samples(-np.inf, navigator.time)
    if not len(stamps):
        raise InputError(f"{reader.path}: {'; '.join(played.failures) or 'no IMU sample'}")
    states = smoothed_voyage(
        navigator,
        stamps,
        played.scenario,
        each_map(maps_for_scenario(played.scenario, build_trajectory(played.scenario))),
        _sensed(reader, played.scenario),
        _figures(played.outputs),
    )
    track = SmoothedTrack(stamps, states)
    figures = _errors(track, navigator, played.outputs)
    paths = write_smoothed(_thinned(track, interval), out)
    _write_bag(track, rates, played, out / "bag")
    return len(stamps), figures, [*paths, out / "bag"]


def _sensed(reader: BagReader, scenario: Scenario) -> list[Sensed | None]:
    """Return what the instruments of a scenario's fields sensed, by the bag; None where that is
    not there as numbers of one channel, or has to be compensated first."""
    adapters = {one.raw: one for one in map(adapter_of, scenario.each_field)}
    found: dict[topics.Topic, dict[float, float]] = {topic: {} for topic in adapters}
    for topic, data in wanted_messages(reader, tuple(adapters.keys() - {topics.MAGNETIC_FIELD})):
        with suppress(BadMessageError):
            sensed, _ = adapters[topic].read_raw(deserialize_message(data, topic.type))
            if np.ndim(sensed) == 0:
                found[topic][to_seconds(peek_ns(data))] = float(sensed)
    in_order = (np.array(sorted(one.items())).T for one in found.values())
    return [Sensed(*one) if len(one) else None for one in in_order]


def _figures(outputs: Collector) -> dict[str, float]:
    """Return the figures of the last batch that are numbers."""
    found: dict[str, float] = {}
    if outputs.batches:
        for name, text in outputs.batches[max(outputs.batches)].items():
            with suppress(ValueError):
                found[name] = float(text)
    return found


def _errors(track: SmoothedTrack, navigator: InertialNavigator, outputs: Collector) -> Figures:
    """Return the figures of the errors; none where the truth is not known."""
    true = Places(outputs.truth).at(_stamps(track, outputs))
    known = np.isfinite(true).all(axis=1)
    if not known.any():
        return {}
    then = navigator.track(track.time)
    place = np.array([state.position[:2] for state in track.states])
    covariance = np.array([state.covariance[:2, :2] for state in track.states])
    of_then = then[:, [10, 11, 11, 12]].reshape(-1, 2, 2)
    found: Figures = {"position_error_rms": {}, "nees_per_axis": {}}
    both = ("smoothed", place, covariance), ("at_the_time", then[:, :2], of_then)
    for name, where, P in both:
        error = np.asarray(horizontal_difference(*where[known].T, *true[known].T))
        found["position_error_rms"][name] = float(np.sqrt((error**2).sum(axis=-1).mean()))
        found["nees_per_axis"][name] = float(np.mean(nees_per_axis(error, P[known])))
    return found


def _stamps(track: SmoothedTrack, outputs: Collector) -> list[int]:
    """Return the stamps (ns) of the states: the filter has published each."""
    return among(track.time.tolist(), outputs.first_nav)


def keep_recording(folder: Path) -> None:
    """Raise InputError where a bag in a folder is a recording, and not an earlier result, which
    `smoothed_files` would replace."""
    if parts(folder):
        first = next(BagReader(folder).messages(), None)
        if first is not None and not topic_of(first.topic, topics.SMOOTHED.name):
            raise InputError(f"{folder}: holds a recording, which must stay; give another --out")


def _write_bag(track: SmoothedTrack, rates: Array, played: Replay, folder: Path) -> None:
    """Write a bag with the states on nav/smoothed, and angular rates (K, 3), rad/s, that the
    gyroscopes measured; a bag in the folder is replaced."""
    scenario = played.scenario
    frame, message = map_frame(scenario), empty_odometry(topics.SMOOTHED)
    writer = BagWriter(folder, {"scenario": scenario_text(scenario)}, replace=True)
    try:
        stamps = _stamps(track, played.outputs)
        for ns, state, rate in zip(stamps, track.states, rates, strict=True):
            fill_state(message, ns, frame, state, rate)
            writer.put(topics.SMOOTHED, message, ns)
    finally:
        writer.close()


def _thinned(track: SmoothedTrack, interval: float) -> SmoothedTrack:
    """Return the states that are at least so many seconds apart, the first and the last among
    them."""
    kept = [0]
    for k, time in enumerate(track.time.tolist()):
        if time - track.time[kept[-1]] >= interval - 1e-6:
            kept.append(k)
    kept = sorted({*kept, len(track.time) - 1})
    return SmoothedTrack(track.time[kept], [track.states[k] for k in kept])
