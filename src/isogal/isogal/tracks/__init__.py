"""Recorded tracks: read, matched against a map, written down.

Reading

- `track`: what is a recorded track, and does it belong to a map?
- `csv_file`: how is one read from a text file?
- `averaging`: which neighbouring readings become one?
- `recording`: how is one read from a bag?

Matching

- `fields`: what has been read along a track, of one field or several, and what does a matcher
  get for each batch?
- `matching`: which fixes does a track give, batch by batch?
- `informative`: does a fix say anything as a position?
- `bank`: how does a batch become a fix?
- `models`: which errors of map and readings are possible?
- `evidence`: what do the readings of one field say of places?
- `places`: where may a track be?
- `widening`: by how much is a fix less certain than its posterior?
- `continued_map`: what has a map beyond its edge and in its gaps?
- `map_error`: how wrong is a map, by tracks whose positions are known?

Results

- `results`: how are fixes written as JSON, CSV and GeoJSON?
- `figures`: how do track, fixes and readings look, and how likely is each shift?
- `match_report`: how is all this shown on one page?
"""
