"""Map formats in single files; each reader is an entry point of the group `isogal.map_formats`.

format             what a format is; window, units and plausibility of every map
netcdf             NetCDF, CF and GMT (COARDS) conventions
netcdf_writing     maps into NetCDF
geotiff            GeoTIFF in any coordinate reference system
gdf                ICGEM grids
xyz                text tables
points             from a list of points on a grid to the grid
"""
