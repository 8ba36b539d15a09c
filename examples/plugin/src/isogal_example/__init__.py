"""What this package adds to Isogal.

least_squares  a matcher: which shift of the track fits the map best?
esri_ascii     a map format: what does an ESRI ASCII grid say?"""
