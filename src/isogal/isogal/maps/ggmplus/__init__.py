"""GGMplus, a gravity model of the land areas in tiles.

tiles       the layout: names, places and numbers of tiles
reading     maps from a folder of tiles (entry point of `isogal.map_formats`)
fetch       tiles from a mirror into a folder, each with its checksum
"""
