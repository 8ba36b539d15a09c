"""Linear dynamics of the navigator's error (docs/mathematics.md, section 3.2).

The local-navigation-frame model of Groves (2013, section 14.2.4; Titterton & Weston 2004, section
12.3) without vertical position and velocity, whose errors the known height holds at zero:
horizontal position and velocity, attitude, accelerometer and gyroscope biases. Errors are
estimate minus truth; the estimated attitude is (I + [psi x]) times the true one.

With L the latitude, w the Earth's rate, M and N the radii, w_in = w_ie + w_en the rate of the
navigation frame and f the specific force:

    d(p_n)/dt = v_n'            d(p_e)/dt = v_e' + tan L / (N + h) (v_e p_n - v_n p_e)
    d(v')/dt  = psi x f + C b_a + error of -(2 w_ie + w_en) x v      (horizontal rows)
    d(psi)/dt = -w_in x psi + C b_g - error of w_in

where a prime marks an error, p is in metres (so the change of N cos L along the track enters) and
C turns body axes into NED."""

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import EARTH_RATE

STATES = 13
"""Position 0-1, velocity 2-3, attitude 4-6, accelerometer bias 7-9, gyroscope bias 10-12."""


@kernel
def fill_dynamics(F: Array, geometry: Array, force: Array, rotation: Array) -> None:
    """Write F of dx/dt = F x into the first 13 rows and columns of a zeroed matrix, in place.

    `geometry` (5,) is latitude (rad), north and east velocity (m/s), 1 / (M + h), 1 / (N + h)
    (1/m); `force` (3,) the specific force, NED, m/s²; `rotation` (3, 3) body to NED."""
    latitude, vn, ve, inv_m, inv_n = geometry
    s, c = np.sin(latitude), np.cos(latitude)
    t = s / c
    fn, fe, fd = force
    # position
    F[0, 2] = 1.0
    F[1, 3] = 1.0
    F[1, 0] = ve * t * inv_n
    F[1, 1] = -vn * t * inv_n
    # velocity: psi x f, then Coriolis and transport; only the down component of 2 w_ie + w_en
    # meets horizontal velocity
    down = -2.0 * EARTH_RATE * s - ve * t * inv_n
    down_by_north = (-2.0 * EARTH_RATE * c - ve * inv_n / (c * c)) * inv_m
    F[2, 5] = fd
    F[2, 6] = -fe
    F[3, 4] = -fd
    F[3, 6] = fn
    F[2, 0] = ve * down_by_north
    F[2, 3] = down - ve * t * inv_n
    F[3, 0] = -vn * down_by_north
    F[3, 2] = -down
    F[3, 3] = vn * t * inv_n
    # attitude: -w_in x psi
    wn, we, wd = EARTH_RATE * c + ve * inv_n, -vn * inv_m, -EARTH_RATE * s - ve * t * inv_n
    F[4, 5] = wd
    F[4, 6] = -we
    F[5, 4] = -wd
    F[5, 6] = wn
    F[6, 4] = we
    F[6, 5] = -wn
    # attitude: minus the error of w_in, by latitude (north error) and by velocity
    F[4, 0] = EARTH_RATE * s * inv_m
    F[6, 0] = (EARTH_RATE * c + ve * inv_n / (c * c)) * inv_m
    F[4, 3] = -inv_n
    F[5, 2] = inv_m
    F[6, 3] = t * inv_n
    # biases
    for i in range(3):
        for j in range(3):
            F[4 + i, 10 + j] = rotation[i, j]
            if i < 2:
                F[2 + i, 7 + j] = rotation[i, j]
