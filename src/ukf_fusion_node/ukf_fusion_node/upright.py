"""Whether the accelerometers feel gravity where the navigator has it: wrong axes or units of an
IMU, or a lost attitude, show there even where nothing else measures the height."""

from isogal.arrays import Array
from isogal.inertial.rotations import rotate
from ukf_fusion_node.watch import GRAVITY

LASTS = 60.0
"""s over which the specific force is averaged."""
MOST = 3.0
"""m/s² by which the mean may differ from gravity: a vehicle that does so truly changes its
vertical speed by 180 m/s within a minute. Banked or not does not matter."""


class Upright:
    """Averages the upward specific force, minute by minute."""

    def __init__(self) -> None:
        self._sum, self._count, self._since = 0.0, 0, float("nan")
        self._text: str | None = None

    def take(self, time: float, force: Array, attitude: Array) -> str | None:
        """Take a sample and return what was wrong over the last whole minute; None = nothing.

        Parameters
        ----------
        time : float
            s, increasing.
        force : (3,) array
            Specific force FRD, m/s².
        attitude : (4,) array
            Quaternion w, x, y, z that turns FRD to north, east, down.
        """
        if not self._count:
            self._since = time
        self._sum -= rotate(*attitude, *force)[2]
        self._count += 1
        if time - self._since >= LASTS:
            mean, self._sum, self._count = self._sum / self._count, 0.0, 0
            self._text = None if abs(mean - GRAVITY) <= MOST else _text(mean)
        return self._text


def _text(mean: float) -> str:
    return (
        f"specific force over a minute is {mean:.3g} m/s² upwards, not {GRAVITY:.3g}: axes (x"
        " forward, y left, z up) or units (m/s², rad/s) of imu/data_raw are wrong, or the attitude"
        " is lost"
    )
