"""From survey readings to a map with its own 1-sigma and correlation length at every node
(docs/maps.md, "From survey readings to a map").

    survey          readings at points or along lines
    reading         from files
    rows            rows of files with named columns: text, Geosoft XYZ, MGD77, NetCDF
    mgd77           track lines of ships
    reduction       trend, and means in blocks
    levelling       where lines cross, and an offset for each line
    covariance      of the field between places, of noise and of lines' offsets
    misfit          how unlikely readings are under it
    learning        its parameters, from the readings
    kriging         the field and its uncertainty from the nearest readings
    error_lengths   over which distance errors hold together, and in which direction further
    validation      readings left out and predicted from the others
    amplitude       where errors are larger or smaller than the covariance says
    spacing         how far apart nodes are to be
    gridder         all of it, one after the other
"""
