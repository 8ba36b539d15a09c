"""What an inertial sample says of its own noise beyond what the model has: the attitude is as much
less certain (docs/mathematics.md, section 3.17)."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.fusion.measurements.model import Innovation
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.rotations import matrix


@dataclass(frozen=True, slots=True, eq=False)
class SampleNoise:
    """The noise of the gyroscopes in the sample that ends at this time, as it was declared with
    it. Of an axis whose declared noise is below that of the model, the model's holds."""

    variance: Array
    """(3,) of the mean rate over the interval, body axes, (rad/s)²."""
    interval: float
    """s."""

    def update(self, state: FilterState, model: FilterModel) -> Innovation:
        """See `isogal.fusion.measurements.Measurement`."""
        if not (np.isfinite(self.variance).all() and self.interval > 0.0):
            raise ValueError("noise of an inertial sample is not finite")
        assumed = np.square(model.noise[3:6]) / self.interval
        more = np.maximum(np.asarray(self.variance) - assumed, 0.0) * self.interval**2
        to_north = matrix(state.attitude)
        state.covariance[6:9, 6:9] += (to_north * more) @ to_north.T
        return Innovation.of(np.zeros(2), 0.0, np.inf)
