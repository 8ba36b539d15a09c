"""The arithmetic of a navigation message as one compiled call: it runs at every step, twice."""

import math

import numpy as np

from isogal.compiled import kernel
from isogal.earth.ellipsoid import E2, A


@kernel
def odometry(state, covariance, axes, origin, pose, twist):  # type: ignore[no-untyped-def]
    """Return position (3) and orientation quaternion (4; w first) in the frame ``map``, and
    velocity (3) FLU, as one array of 10.

    Parameters
    ----------
    state : (10,) array
        Latitude rad, longitude rad, height m, velocity NED m/s, quaternion FRD to NED.
    covariance : (9+, 9+) array
        Position, velocity, attitude errors, NED; (0, 0) = none.
    axes, origin : (3, 3), (3,) arrays
        Of the frame: rotation from ECEF to its axes, ECEF of its origin.
    pose, twist : (6, 6) arrays
        Written where there is a covariance.
    """
    lat, lon, height = state[0], state[1], state[2]
    sl, cl, so, co = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    n = A / math.sqrt(1.0 - E2 * sl * sl)
    ecef = np.array(
        [(n + height) * cl * co, (n + height) * cl * so, (n * (1.0 - E2) + height) * sl]
    )
    # columns: north, east, down in ECEF
    ned = np.array([[-sl * co, -so, -cl * co], [-sl * so, co, -cl * so], [cl, 0.0, -sl]])
    to_map = axes @ ned
    w, x, y, z = state[6], state[7], state[8], state[9]
    # FLU to NED: the library's rotation with its second and third column turned round
    body = np.array(
        [
            [1 - 2 * (y * y + z * z), -2 * (x * y - w * z), -2 * (x * z + w * y)],
            [2 * (x * y + w * z), -(1 - 2 * (x * x + z * z)), -2 * (y * z - w * x)],
            [2 * (x * z - w * y), -2 * (y * z + w * x), -(1 - 2 * (x * x + y * y))],
        ]
    )
    result = np.empty(10)
    result[:3] = axes @ (ecef - origin)
    result[3:7] = quaternion(to_map @ body)
    to_body = np.ascontiguousarray(body.T)
    result[7:] = to_body @ state[3:6]
    if covariance.shape[0] > 0:
        turn = np.ascontiguousarray(to_map.T)
        pose[:3, :3] = to_map @ np.ascontiguousarray(covariance[:3, :3]) @ turn
        pose[:3, 3:] = to_map @ np.ascontiguousarray(covariance[:3, 6:9]) @ turn
        pose[3:, :3] = pose[:3, 3:].T
        pose[3:, 3:] = to_map @ np.ascontiguousarray(covariance[6:9, 6:9]) @ turn
        twist[:3, :3] = to_body @ np.ascontiguousarray(covariance[3:6, 3:6]) @ body
    return result


@kernel
def quaternion(rotation):  # type: ignore[no-untyped-def]
    """Return (w, x, y, z) of a rotation matrix (3, 3), from its largest component (Shepperd
    1978)."""
    a, b, c = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    d, e, f = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    g, h, i = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    squares = np.array([a + e + i, a - e - i, e - a - i, i - a - e])
    largest = int(np.argmax(squares))
    s = math.sqrt(1.0 + squares[largest]) * 2.0
    if largest == 0:
        q = (s / 4.0, (h - f) / s, (c - g) / s, (d - b) / s)
    elif largest == 1:
        q = ((h - f) / s, s / 4.0, (b + d) / s, (c + g) / s)
    elif largest == 2:
        q = ((c - g) / s, (b + d) / s, s / 4.0, (f + h) / s)
    else:
        q = ((d - b) / s, (c + g) / s, (f + h) / s, s / 4.0)
    return np.array(q)
