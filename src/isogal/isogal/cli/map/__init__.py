"""``isogal map``: look at maps, make, fetch and convert them.

- `app`: the group of commands.
- `info`: what is a map, how good can fixes be along a route, how much does it vary there?
- `navigability`: where can one navigate?
- `writing`: the synthetic map, maps in another form, at another height, from survey readings.
- `fetch`: tiles from a mirror.
- `part`: which part of a map, along which route?
- `results`: how is a result described, printed and written?
- `figures`: how are maps drawn?
"""
