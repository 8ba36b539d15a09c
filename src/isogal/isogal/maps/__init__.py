"""Maps: scalar fields on regular latitude/longitude grids, their readers, and what can be read off
them."""
