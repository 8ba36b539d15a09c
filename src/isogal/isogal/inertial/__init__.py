"""Attitude algebra and strapdown navigation."""
