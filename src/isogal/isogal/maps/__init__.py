"""Maps: scalar fields on regular grids of latitude and longitude.

    field_map            the map in memory: value, gradient, error
    interpolation        the grid as compiled functions take it, and interpolation on it
    channels             several maps on one grid; types of map that functions take
    several              the maps of several fields
    tiled_map            a map too large for the memory, read in tiles
    corridor             the part of the Earth along a route
    axes                 windows, regular axes, and the part of an axis that a window needs
    load                 which format does a file have? does a map cover a route?
    quantities           quantities, units, and which values are possible
    cache                the user's cache folder, and locks of files

What maps are used for:

    expected_accuracy    how good can a fix be here?
    variability          map feature variability (paper eq. CV)
    potential            the gravity vector and its gradient tensor from the disturbance
    spectral             Fourier transforms of a map over a plane
    error_model          the covariance of a map's errors, between places and along a track
    error_spectrum       what becomes of a map's errors in such a transform

Where maps come from:

    formats              from files to maps: NetCDF, GeoTIFF, ICGEM, text
    ggmplus              folders of GGMplus tiles, and their mirrors
    synthetic            the synthetic map
    continuation         a map at another height
    gridding             a map from survey readings
"""
