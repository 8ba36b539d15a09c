"""NetCDF maps: CF and GMT conventions in, CF out."""
