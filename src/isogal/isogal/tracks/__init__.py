"""Recorded tracks: reading them, matching them against a map, writing what was found."""
