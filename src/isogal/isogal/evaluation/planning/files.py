"""A route as a file: waypoints of a scenario, GeoJSON, or a nav_msgs/Path as ``ros2 topic pub``
reads it."""

import json
import math
from pathlib import Path

import numpy as np

from isogal.arrays import Integers
from isogal.earth.frames import LocalFrame
from isogal.evaluation.planning.planner import Assessed
from isogal.files import geojson_line, write_atomic


def write_route(route: Assessed, path: Path) -> None:
    """Write the waypoints: as GeoJSON where the name ends so, else as a scenario's section
    `route`."""
    text = _geojson(route) if path.suffix.casefold() == ".geojson" else _yaml(route)
    write_atomic(path, text)


def _yaml(route: Assessed) -> str:
    import yaml

    settings = route.driven
    section = {
        "waypoints": [[round(a, 7), round(b, 7), c] for a, b, c in settings.waypoints or ()],
        "height": settings.height,
        "turn_rate": settings.turn_rate,
        "duration": None,
    }
    return yaml.safe_dump({"route": section}, sort_keys=False, default_flow_style=None)


def _some(count: int, most: int) -> Integers:
    """Return indices of evenly some of so many rows, with the last."""
    return np.unique([*range(0, count, max(1, count // most)), count - 1])


def _geojson(route: Assessed) -> str:
    index, track = _some(len(route.bound.time), 200), route.trajectory
    steps = np.searchsorted(track.time, route.bound.time[index])
    line = np.degrees(np.column_stack([track.longitude[steps], track.latitude[steps]]))
    properties = {
        "length_m": route.length,
        "error_on_arrival_m": route.error,
        "expected_error_m": route.bound.rms[index].round(2).tolist(),
    }
    feature = {
        "type": "Feature",
        "properties": properties,
        "geometry": geojson_line(line.round(7).tolist()),
    }
    return json.dumps({"type": "FeatureCollection", "features": [feature]}) + "\n"


def write_path(route: Assessed, path: Path) -> None:
    """Write a nav_msgs/Path in the frame `map` (east, north, up at the first point) as YAML."""
    import yaml

    track, index = route.trajectory, _some(len(route.trajectory.latitude), 500)
    frame = LocalFrame(track.latitude[0], track.longitude[0], track.height[0])
    places = frame.from_geodetic(
        track.latitude[index], track.longitude[index], track.height[index]
    )
    heading = np.arctan2(track.velocity[index, 1], track.velocity[index, 0])
    poses = []
    for place, turn, seconds in zip(places, heading, track.time[index].tolist(), strict=True):
        yaw = 0.5 * math.pi - turn  # from east, anticlockwise (REP-103)
        stamp = {"sec": int(seconds), "nanosec": round(1e9 * (seconds % 1.0))}
        pose = {
            "position": dict(zip("xyz", (round(float(x), 3) for x in place), strict=True)),
            "orientation": {"z": math.sin(0.5 * yaw), "w": math.cos(0.5 * yaw)},
        }
        poses.append({"header": {"stamp": stamp, "frame_id": "map"}, "pose": pose})
    message = {"header": {"frame_id": "map"}, "poses": poses}
    write_atomic(path, yaml.safe_dump(message, sort_keys=False))
