"""Figures, drawn as for a journal: SI units on the axes, readable for the colour-blind and in
grey.

Each function takes records or arrays and returns a matplotlib Figure that belongs to no window and
to no global state; `isogal.evaluation.figures.style.png` turns it into bytes. Importing these
modules does not import matplotlib."""
