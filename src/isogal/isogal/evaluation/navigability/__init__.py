"""Where can one navigate? (docs/maps.md, "Where can I navigate?")

leg      the navigator's error along a straight leg that ends at a place
kernels  the bound, and the probability of a second place, at many nodes
area     both over the area of a map, by heading
files    the result as NetCDF or GeoTIFF
"""
