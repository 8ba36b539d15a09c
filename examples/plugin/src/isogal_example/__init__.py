"""What this package adds to Isogal.

least_squares      a matcher: which shift of the track fits the map best?
esri_ascii         a map format: what does an ESRI ASCII grid say?
free_air           a field: what does a gravimeter at sea say about the free-air anomaly?
free_air_messages  in which ROS messages does it say so?"""
