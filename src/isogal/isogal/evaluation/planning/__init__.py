"""Which route lets the navigator arrive with the least error? (docs/maps.md, "Planning a route")

areas       areas that a route must keep out of, from GeoJSON
lattice     places and straight edges between start and goal
belief      the navigator's error covariance along an edge
planner     the search, and what the bound says of the route found
files       the route as a scenario's waypoints, GeoJSON or nav_msgs/Path
"""
