"""The page of `isogal view`: one run to look through, in one HTML file that needs no network
(docs/view.md).

record      what the page shows: a run, what nodes said, what was not recorded
payload     the numbers of the page, which change while a run is watched
background  the map as a shaded picture and as contours
figures     the maps and the panels over time, with their titles and keys (Bokeh)
page        the file

The page's style, its script and its frame are ``view.css``, ``view.js`` and ``view.html``."""
