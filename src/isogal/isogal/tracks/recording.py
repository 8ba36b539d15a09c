"""Recorded tracks in bags (MCAP, as ``ros2 bag`` and Isogal's recorder write them), read without ROS."""

import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.tracks.track import Track, track_window

Array = NDArray[np.float64]

FIX_TOPIC = "nav/fix"
READING_TOPICS = {"gravity": "gravimeter/gravity", "disturbance": "gravimeter/disturbance"}
"""Topic of the readings by quantity of the map."""
_TYPES = {"sensor_msgs/msg/NavSatFix": "position", "geometry_msgs/msg/AccelWithCovarianceStamped": "reading"}


def is_recording(path: Path) -> bool:
    """Whether a path is a bag by its looks: an MCAP file, or a folder."""
    return path.is_dir() or path.suffix.casefold() == ".mcap"


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """What a bag holds of a track."""

    where: str
    time: Array
    """(M,) s, stamps of the navigator's positions."""
    latitude: Array
    """(M,) rad."""
    longitude: Array
    """(M,) rad, continuous."""
    readings: Mapping[str, Array]
    """(N, 3) stamp s, value m/s², variance by quantity."""

    def window(self, margin: float) -> Window:
        """Return the part of a map within a margin (m) of the track."""
        return track_window(self.latitude, self.longitude, margin)

    def track(self, quantity: str, sensor_sigma: float | None) -> Track:
        """Return the readings of a quantity with the navigator's position at their stamps (between two positions, linearly).

        They were reduced with the navigator's own estimate (`Track.reduction`).

        Parameters
        ----------
        quantity : str
            Of the map.
        sensor_sigma : float, optional
            1-sigma of the readings, m/s²; None = as the messages say.

        Raises
        ------
        InputError
            No readings of that quantity, none with a position, or none that says its variance.
        """
        if quantity not in self.readings:
            known = f"readings of {' and '.join(self.readings)}" if self.readings else "no readings"
            raise InputError(f"{self.where}: has {known}, and the map is of {quantity}")
        rows = self.readings[quantity]
        rows = rows[(self.time[0] <= rows[:, 0]) & (rows[:, 0] <= self.time[-1])]
        if not rows.size:
            raise InputError(f"{self.where}: no reading lies between the first and the last position")
        time, value, variance = rows.T
        if sensor_sigma is None and not (variance > 0.0).all():
            raise InputError(f"{self.where}: the readings do not say their variance; give --sensor-sigma")
        return Track(
            time=time,
            latitude=np.interp(time, self.time, self.latitude),
            longitude=np.interp(time, self.time, self.longitude),
            value=value,
            sigma=np.sqrt(variance) if sensor_sigma is None else np.full(time.size, sensor_sigma),
            offset=np.zeros(time.size),
            where=self.where,
            reduction="velocity",
        )


def read_recording(path: str | Path, fix_topic: str = FIX_TOPIC) -> Recording:
    """Read positions and readings from a bag.

    Parameters
    ----------
    path : path
        Folder of the bag, or one MCAP file. A file that was cut short counts as far as it goes.
    fix_topic : str
        NavSatFix of the navigator. Where a stamp comes twice (before and after a fix), the first counts: the readings were reduced with it.

    Raises
    ------
    InputError
        No bag, no positions or no readings in it, or a topic of another type.
    """
    positions: dict[float, tuple[float, float]] = {}
    readings: dict[str, dict[float, tuple[float, float]]] = {quantity: {} for quantity in READING_TOPICS}
    seen: set[str] = set()
    for name, kind, message in _messages(Path(path)):
        seen.add(name)
        if _is(name, fix_topic):
            _require(kind, "position", path, name)
            if message.status.status >= 0:
                positions.setdefault(_stamp(message), (message.latitude, message.longitude))
        for quantity, topic in READING_TOPICS.items():
            if _is(name, topic):
                _require(kind, "reading", path, name)
                accel = message.accel
                readings[quantity].setdefault(_stamp(message), (accel.accel.linear.z, accel.covariance[14]))
    if not positions or not any(readings.values()):
        wanted = f"'{fix_topic}'" if not positions else " or ".join(f"'{topic}'" for topic in READING_TOPICS.values())
        raise InputError(f"{path}: has no message on {wanted}; it has {', '.join(sorted(seen)) or 'none at all'}")
    time = np.array(sorted(positions))
    latitude, longitude = np.radians([positions[t] for t in time]).T
    return Recording(
        where=str(path),
        time=time,
        latitude=latitude,
        longitude=np.unwrap(longitude),
        readings={
            quantity: np.array([(t, *found[t]) for t in sorted(found)]) for quantity, found in readings.items() if found
        },
    )


def _messages(path: Path) -> Iterator[tuple[str, str, Any]]:
    """Yield (topic, what it is, decoded message) of the positions and readings in a bag, as far as it can be read."""
    from mcap.exceptions import McapError
    from mcap.reader import NonSeekingReader
    from mcap_ros2.decoder import DecoderFactory

    for file in _files(path):
        empty = True
        try:
            with file.open("rb") as stream:
                decoders: dict[int, Any] = {}
                factory = DecoderFactory()
                for schema, channel, message in NonSeekingReader(stream).iter_messages(log_time_order=False):
                    empty = False
                    kind = _TYPES.get(schema.name, "") if schema else ""
                    if not kind:
                        yield channel.topic, "", None
                        continue
                    if channel.id not in decoders:
                        decoders[channel.id] = factory.decoder_for(channel.message_encoding, schema)
                    yield channel.topic, kind, decoders[channel.id](message.data)
        except (McapError, struct.error, EOFError, KeyError, ValueError, TypeError) as error:
            if empty:
                raise InputError(f"{file}: cannot be read as MCAP ({type(error).__name__})") from None
            # cut short, as by a power failure: what was read counts


def _files(path: Path) -> list[Path]:
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    if path.is_file():
        return [path]
    files = sorted(path.glob("*.mcap"), key=lambda file: (len(file.name), file.name))  # _0, _1, ... _10
    if not files:
        raise InputError(f"{path}: no MCAP file in this folder")
    return files


def _is(recorded: str, name: str) -> bool:
    """Whether a recorded (absolute) topic is the one of that name, in whatever namespace."""
    return recorded == name or recorded.endswith("/" + name.lstrip("/"))


def _require(kind: str, wanted: str, path: str | Path, topic: str) -> None:
    if kind != wanted:
        types = {value: key for key, value in _TYPES.items()}
        raise InputError(f"{path}: topic '{topic}' must be of type {types[wanted]}")


def _stamp(message: Any) -> float:
    stamp = message.header.stamp
    seconds = stamp.sec + 1e-9 * stamp.nanosec
    if not math.isfinite(seconds):
        raise ValueError("stamp")
    return float(seconds)
