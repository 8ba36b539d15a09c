"""Cleaning a magnetometer of the vehicle's own field (docs/magnetometer.md).

Model

- `terms`: which terms has the Tolles-Lawson model?
- `readings`: what do a scalar and a vector magnetometer give, and a base station?
- `flight`: how are they read from text files, and a compensated track written?
- `compensation`: the coefficients, their file, and how they are applied.
- `stream`: how are they applied to readings as they come?

Learning it

- `band_pass`: the band in which manoeuvres are, and nothing else.
- `calibration`: coefficients from a calibration flight, and by how much the vector magnetometer is
  late.
- `online`: coefficients as states of a recursive estimator, from a cold start.

What it is checked against

- `aircraft`: a magnetic aircraft by its moment and tensors, and errors of the instruments.
- `manoeuvres`: simulated flights of it.
"""
