"""Recorded tracks in bags, MCAP files as ``ros2 bag`` and Isogal's recorder write them; read
without ROS."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import unreadable
from isogal.mcap_files import SUFFIXES, is_damage, opened, parts, records_of
from isogal.tracks.track import Track

Message = Any
"""Of a class that mcap_ros2 makes from the schema of a bag."""
FIX_TOPIC = "nav/fix"
_POSITION = "sensor_msgs/msg/NavSatFix"
_ACCEL = "geometry_msgs/msg/AccelWithCovarianceStamped"
_FIELD = "sensor_msgs/msg/MagneticField"


class ReadingSource(NamedTuple):
    """Where the reduced readings of one quantity are in a bag."""

    topic: str
    type: str
    reduction: str
    """What of the navigator's estimate they were reduced with (`Track.reduction`)."""


READINGS = {
    "gravity": ReadingSource("gravimeter/gravity", _ACCEL, "velocity"),
    "disturbance": ReadingSource("gravimeter/disturbance", _ACCEL, "velocity"),
    "magnetic_anomaly": ReadingSource("magnetometer/anomaly", _FIELD, "main-field"),
    "height": ReadingSource("altimeter/terrain", _POSITION, "none"),
}
"""Where the readings are that a map of a quantity needs."""
_READ: dict[str, Callable[[Message], tuple[float, float]]] = {
    _ACCEL: lambda m: (m.accel.accel.linear.z, m.accel.covariance[14]),
    # messages have T, maps have nT
    _FIELD: lambda m: (m.magnetic_field.z * 1e9, m.magnetic_field_covariance[8] * 1e9**2),
    _POSITION: lambda m: (m.altitude, m.position_covariance[8]),
}
"""Value and variance of a reading, unit inside, by the message's type."""


def is_recording(path: Path) -> bool:
    """Return whether a path is to be read as a bag: by its suffix, or because it is a folder."""
    return path.is_dir() or path.name.casefold().endswith(SUFFIXES)


def read_recording(path: str | Path, fix_topic: str = FIX_TOPIC) -> list[Track]:
    """Read positions and readings from a bag.

    Parameters
    ----------
    path : path
        Folder of the bag, or one MCAP file. Of a file that was cut short, the complete messages
        are read.
    fix_topic : str
        NavSatFix of the navigator. The navigator publishes a stamp again after a fix; the first
        message counts, since the readings were reduced with it.

    Returns
    -------
    list of Track
        Of each quantity the readings, unit inside, with the navigator's positions at their stamps,
        interpolated linearly. They were reduced with the navigator's own estimate; a sigma is NaN
        where a message does not say it.

    Raises
    ------
    InputError
        There is no bag, no position or no reading in it, none between the first and the last
        position, or a topic has another type.
    """
    sources = {"": ReadingSource(fix_topic, _POSITION, "none")} | READINGS
    found: dict[str, dict[float, tuple[float, float]]] = {quantity: {} for quantity in sources}
    seen: set[str] = set()
    for topic, kind, message in _messages(Path(path)):
        seen.add(topic)
        for quantity, source in sources.items():
            if topic != source.topic and not topic.endswith("/" + source.topic.lstrip("/")):
                continue  # in whatever namespace
            if kind != source.type:
                raise InputError(f"{path}: topic '{topic}' must be of type {source.type}")
            if quantity:
                found[quantity].setdefault(_stamp(message), _READ[kind](message))
            elif message.status.status >= 0:
                place = message.latitude, message.longitude
                found[quantity].setdefault(_stamp(message), place)
    each = {name: np.array([(t, *own[t]) for t in sorted(own)]) for name, own in found.items()}
    positions, readings = each.pop(""), {name: rows for name, rows in each.items() if rows.size}
    if not positions.size or not readings:
        wanted = READINGS.values() if positions.size else [sources[""]]
        raise InputError(
            f"{path}: has no message on {' or '.join(repr(one.topic) for one in wanted)}; it has"
            f" {', '.join(sorted(seen)) or 'none at all'}"
        )
    made = [_track(str(path), quantity, rows, positions) for quantity, rows in readings.items()]
    tracks = [track for track in made if len(track)]
    if not tracks:
        raise InputError(f"{path}: no reading lies between the first and the last position")
    return tracks


def _track(where: str, quantity: str, rows: Array, positions: Array) -> Track:
    """Return readings (N, 3) as stamp, value and variance with the positions (M, 3), stamp and
    deg, at their stamps; without those before the first and after the last of these."""
    clock, latitude, longitude = positions.T
    time, value, variance = rows[(clock[0] <= rows[:, 0]) & (rows[:, 0] <= clock[-1])].T
    return Track(
        time=time,
        latitude=np.interp(time, clock, np.radians(latitude)),
        longitude=np.interp(time, clock, np.unwrap(np.radians(longitude))),
        value=value,
        sigma=np.sqrt(np.where(variance > 0.0, variance, np.nan)),
        offset=np.zeros(time.size),
        where=where,
        reduction=READINGS[quantity].reduction,
        quantity=quantity,
    )


def _messages(path: Path) -> Iterator[tuple[str, str, Message]]:
    """Yield (topic, type, decoded message) of a bag, in the order they were written, as far as it
    can be read; of topics with other types than those of positions and readings only the topic."""
    from mcap.records import Channel, Schema
    from mcap.records import Message as Record
    from mcap_ros2.decoder import DecoderFactory

    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    if path.is_dir() and not parts(path):
        raise InputError(f"{path}: no MCAP file in this folder")

    for file in parts(path) or [path]:
        schemas: dict[int, Schema | None] = {0: None}
        channels: dict[int, Channel] = {}
        factory, empty = DecoderFactory(), True
        try:
            with opened(file) as stream:
                for item in (one for _, records in records_of(stream) for one in records):
                    if isinstance(item, Schema):
                        schemas[item.id] = item
                    elif isinstance(item, Channel):
                        channels[item.id] = item
                    elif isinstance(item, Record):
                        empty, channel = False, channels[item.channel_id]
                        schema = schemas[channel.schema_id]
                        if schema is None or schema.name not in _READ:
                            yield channel.topic, "", None
                            continue
                        decode = factory.decoder_for(channel.message_encoding, schema)
                        yield channel.topic, schema.name, decode(item.data)
        except Exception as error:
            if isinstance(error, InputError) or not is_damage(error):
                raise
            if empty:
                raise unreadable(file, "MCAP") from error
            # a recording that was cut short, by a power failure for example, ends here


def _stamp(message: Message) -> float:
    stamp = message.header.stamp
    seconds = stamp.sec + 1e-9 * stamp.nanosec
    if not math.isfinite(seconds):
        raise ValueError("stamp")
    return float(seconds)
