"""Auxiliary states of the inertial sensors: what of their errors is neither a constant bias nor
white noise (docs/mathematics.md, section 3.3).

The in-run bias changes with its own correlation time. Of scale factors and misalignments those
have states that show in turns and when the speed changes: the scale factors of the horizontal
accelerometers and of the vertical gyroscope, and the misalignments of the level gyroscopes towards
the vertical one, as a turn by an angle tilts the platform by the misalignment times that angle
(docs/inertial-sensors.md shows what it costs to leave them out). All others, and the
g-sensitivity, act on the weight or on the Earth's rate, which a level vehicle feels all the time,
and are in the biases (`isogal.sensors.imu_model.bias_sigma`)."""

from collections.abc import Iterator

from isogal.fusion.auxiliary import AuxiliaryState, Enters
from isogal.scenario import ImuErrors, SensorErrors
from isogal.scenario.inertial import Axes

_AXES = "xyz"


def states(sensors: ImuErrors) -> Iterator[AuxiliaryState]:
    """Yield the states of inertial sensors; those with a 1-sigma of 0 are none."""
    force, rate = sensors.accelerometer, sensors.gyroscope
    yield from _in_run(force, "accelerometer")
    yield from _in_run(rate, "gyroscope")
    yield from _shares(force.scale_factor, "accelerometer_scale", ((0, 0), (1, 1)))
    yield from _shares(rate.scale_factor, "gyroscope_scale", ((2, 2),))
    yield from _shares(rate.misalignment, "gyroscope_scale", ((0, 2), (1, 2)))


def _in_run(errors: SensorErrors, name: Enters) -> Iterator[AuxiliaryState]:
    """Yield the in-run biases of three accelerometers or gyroscopes."""
    for axis, (sigma, time) in enumerate(
        zip(errors.bias_instability, errors.bias_time, strict=True)
    ):
        yield AuxiliaryState(f"{name}_in_run_{_AXES[axis]}", name, axis, sigma, time=time)


def _shares(
    sigma: Axes, enters: Enters, pairs: tuple[tuple[int, int], ...]
) -> Iterator[AuxiliaryState]:
    """Yield shares of the reading of an axis (the second of each pair) in that of another, or in
    its own."""
    for axis, source in pairs:
        name = f"{enters}_{_AXES[axis]}{_AXES[source]}"
        yield AuxiliaryState(name, enters, axis, sigma[axis], source=source)
