"""Figures of the paper, drawn from what was measured here.

=======  ====================================================================================
errors   RMS errors over time, by noise, batch length, way of aiding and setting
         (figs. 52, 56, 56b, 61, 61a)
maps     Maps with the track, the map look-up in one and in two dimensions
         (figs. 51, 54, 54a, 57)
signals  Readings, map feature variability, movement of the iterations (figs. 56a, 60, 64)
=======  ====================================================================================
"""
