"""Figures of the paper, drawn from what was measured here.

errors     RMS errors over time: by noise, batch length, way of aiding (figs. 52, 56, 61)
maps       maps with the track; the map look-up in one and in two dimensions (figs. 51, 54, 57)
signals    readings, map feature variability, movement of the iterations (figs. 56a, 60, 64)
"""
