"""The synthetic map: fractal terrain and its gravity, on the cells of GGMplus.

synthetic_map    the map of a window, or along a route
tiles            tiles of 1°, made once and kept in the cache folder
terrain          the numbers of a tile: terrain, its gravity, long waves
lattice_noise    gradient noise on a sphere
"""
