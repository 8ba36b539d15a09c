"""Figures in a journal's style: units on the axes, legible with any colour vision and in grey.

Each function takes records or arrays and returns a matplotlib Figure that belongs to no window and
to no global state; `style.png` turns it into bytes. Importing these modules does not import
matplotlib.

    style       palette, line styles, sizes, axes of time and of map values, legends
    errors      errors of one run or many over time, with the bound; NEES; protection level
    signal      readings, or the map feature variability, against the map along the track
    track       the track on the map
"""
