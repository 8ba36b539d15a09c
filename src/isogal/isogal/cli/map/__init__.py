"""``isogal map``: look at maps, make, fetch and convert them.

- `app`: the group of commands.
- `info`: what is a map, and how good can fixes be along a route?
- `variability`: how much does a map vary around each reading?
- `continuation`: the map at another height.
- `grid`: a map from survey readings.
- `navigability`: where can one navigate?
- `navigability_figure`: and its figure.
- `synth`, `fetch`, `convert`: where does a map come from, and in which form?
- `part`: which part of a map, along which route?
- `results`: how is a result printed, and where is a picture written?
- `description`: what is said about a map and a route.
- `figures`: how are they drawn?
"""
