"""Baselines: matchers after their sources, to compare the default one with. Each is one file.

    tercom         mean absolute difference over a grid of shifts
    iccp           iterated closest contour point
    sitan          extended Kalman filter on the slope of the map
    particle       bootstrap filter, Rao-Blackwellised
    point_mass     Bayes' rule on a grid
    viterbi        hidden Markov cells

What they share:

    baseline    settings, options, batches that cannot be matched
    readings    readings of a batch as arrays; from a posterior or a shift to a fix
"""
