"""``isogal match``: a recorded track of any scalar field against a map.

- `command`: the command, from the options to the results.
- `options`: what can be said about track, matcher, errors and results?
- `inputs`: the fields, of each the track and the map, in one unit.
"""
