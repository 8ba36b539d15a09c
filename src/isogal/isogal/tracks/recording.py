"""Recorded tracks in bags (MCAP, as ``ros2 bag`` and Isogal's recorder write them), read without
ROS."""

import math
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.tracks.track import Track, track_window

FIX_TOPIC = "nav/fix"
_POSITION = "sensor_msgs/msg/NavSatFix"
_NANOTESLA = 1e9
"""nT in 1 T, which messages have."""


@dataclass(frozen=True)
class ReadingSource:
    """Where a bag has the reduced readings of one quantity."""

    topic: str
    type: str
    read: Callable[[Any], tuple[float, float]]
    """Value and variance in the unit inside, of a message."""
    reduction: str
    """What of the navigator's estimate went into them, see `Track.reduction`."""


def _accel(message: Any) -> tuple[float, float]:
    return message.accel.accel.linear.z, message.accel.covariance[14]


def _anomaly(message: Any) -> tuple[float, float]:
    return (
        message.magnetic_field.z * _NANOTESLA,
        message.magnetic_field_covariance[8] * _NANOTESLA**2,
    )


def _altitude(message: Any) -> tuple[float, float]:
    return message.altitude, message.position_covariance[8]


_ACCEL = "geometry_msgs/msg/AccelWithCovarianceStamped"
READINGS = {
    "gravity": ReadingSource("gravimeter/gravity", _ACCEL, _accel, "velocity"),
    "disturbance": ReadingSource("gravimeter/disturbance", _ACCEL, _accel, "velocity"),
    "magnetic_anomaly": ReadingSource(
        "magnetometer/anomaly", "sensor_msgs/msg/MagneticField", _anomaly, "main-field"
    ),
    "height": ReadingSource("altimeter/terrain", _POSITION, _altitude, "none"),
}
"""By quantity of the map."""
_TYPES = {_POSITION, *(source.type for source in READINGS.values())}


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
    """(N, 3) stamp s, value, variance by quantity, units inside."""

    def window(self, margin: float) -> Window:
        """Return the part of a map within a margin (m) of the track."""
        return track_window(self.latitude, self.longitude, margin)

    def track(self, quantity: str, sensor_sigma: float | None) -> Track:
        """Return the readings of a quantity with the navigator's position at their stamps (between
        two positions, linearly).

        They were reduced with the navigator's own estimate (`Track.reduction`).

        Parameters
        ----------
        quantity : str
            Of the map.
        sensor_sigma : float, optional
            1-sigma of the readings, unit inside; None = as the messages say.

        Raises
        ------
        InputError
            No readings of that quantity, none with a position, or none that says its variance.
        """
        if quantity not in self.readings:
            known = (
                f"readings of {' and '.join(self.readings)}" if self.readings else "no readings"
            )
            raise InputError(f"{self.where}: has {known}, and the map is of {quantity}")
        rows = self.readings[quantity]
        rows = rows[(self.time[0] <= rows[:, 0]) & (rows[:, 0] <= self.time[-1])]
        if not rows.size:
            raise InputError(
                f"{self.where}: no reading lies between the first and the last position"
            )
        time, value, variance = rows.T
        if sensor_sigma is None and not (variance > 0.0).all():
            raise InputError(
                f"{self.where}: the readings do not say their variance; give --sensor-sigma"
            )
        return Track(
            time=time,
            latitude=np.interp(time, self.time, self.latitude),
            longitude=np.interp(time, self.time, self.longitude),
            value=value,
            sigma=np.sqrt(variance) if sensor_sigma is None else np.full(time.size, sensor_sigma),
            offset=np.zeros(time.size),
            where=self.where,
            reduction=READINGS[quantity].reduction,
        )


def read_recording(path: str | Path, fix_topic: str = FIX_TOPIC) -> Recording:
    """Read positions and readings from a bag.

    Parameters
    ----------
    path : path
        Folder of the bag, or one MCAP file. A file that was cut short counts as far as it goes.
    fix_topic : str
        NavSatFix of the navigator. Where a stamp comes twice (before and after a fix), the first
        counts: the readings were reduced with it.

    Raises
    ------
    InputError
        No bag, no positions or no readings in it, or a topic of another type.
    """
    positions: dict[float, tuple[float, float]] = {}
    readings: dict[str, dict[float, tuple[float, float]]] = {quantity: {} for quantity in READINGS}
    seen: set[str] = set()
    for name, kind, message in _messages(Path(path)):
        seen.add(name)
        if _is(name, fix_topic):
            _require(kind, _POSITION, path, name)
            if message.status.status >= 0:
                positions.setdefault(_stamp(message), (message.latitude, message.longitude))
        for quantity, source in READINGS.items():
            if _is(name, source.topic):
                _require(kind, source.type, path, name)
                readings[quantity].setdefault(_stamp(message), source.read(message))
    if not positions or not any(readings.values()):
        wanted = (
            f"'{fix_topic}'"
            if not positions
            else " or ".join(f"'{source.topic}'" for source in READINGS.values())
        )
        raise InputError(
            f"{path}: has no message on {wanted}; it has"
            f" {', '.join(sorted(seen)) or 'none at all'}"
        )
    time = np.array(sorted(positions))
    latitude, longitude = np.radians([positions[t] for t in time]).T
    return Recording(
        where=str(path),
        time=time,
        latitude=latitude,
        longitude=np.unwrap(longitude),
        readings={
            quantity: np.array([(t, *found[t]) for t in sorted(found)])
            for quantity, found in readings.items()
            if found
        },
    )


def _messages(path: Path) -> Iterator[tuple[str, str, Any]]:
    """Yield (topic, type, decoded message) of the positions and readings in a bag, as far as it
    can be read; other types are empty."""
    from mcap.exceptions import McapError
    from mcap.reader import NonSeekingReader
    from mcap_ros2.decoder import DecoderFactory

    for file in _files(path):
        empty = True
        try:
            with file.open("rb") as stream:
                decoders: dict[int, Any] = {}
                factory = DecoderFactory()
                for schema, channel, message in NonSeekingReader(stream).iter_messages(
                    log_time_order=False
                ):
                    empty = False
                    kind = schema.name if schema and schema.name in _TYPES else ""
                    if not kind:
                        yield channel.topic, "", None
                        continue
                    if channel.id not in decoders:
                        decoders[channel.id] = factory.decoder_for(
                            channel.message_encoding, schema
                        )
                    yield channel.topic, kind, decoders[channel.id](message.data)
        except (McapError, struct.error, EOFError, KeyError, ValueError, TypeError) as error:
            if empty:
                raise InputError(
                    f"{file}: cannot be read as MCAP ({type(error).__name__})"
                ) from None
            # cut short, as by a power failure: what was read counts


def _files(path: Path) -> list[Path]:
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    if path.is_file():
        return [path]
    files = sorted(
        path.glob("*.mcap"), key=lambda file: (len(file.name), file.name)
    )  # _0, _1, ... _10
    if not files:
        raise InputError(f"{path}: no MCAP file in this folder")
    return files


def _is(recorded: str, name: str) -> bool:
    """Whether a recorded (absolute) topic is the one of that name, in whatever namespace."""
    return recorded == name or recorded.endswith("/" + name.lstrip("/"))


def _require(kind: str, wanted: str, path: str | Path, topic: str) -> None:
    if kind != wanted:
        raise InputError(f"{path}: topic '{topic}' must be of type {wanted}")


def _stamp(message: Any) -> float:
    stamp = message.header.stamp
    seconds = stamp.sec + 1e-9 * stamp.nanosec
    if not math.isfinite(seconds):
        raise ValueError("stamp")
    return float(seconds)
