"""What benchmarks/montecarlo.py compares: CPU times of the same work done by Isogal and others.

    closed_loop        Isogal's Monte Carlo, as a whole and by part
    filterpy_filter    the unscented filter: Isogal and filterpy
    stonesoup_pmht     matching: Isogal's `pmht-paper` and Stone Soup's PMHT tracker

All times are CPU times of the calling thread.
"""
