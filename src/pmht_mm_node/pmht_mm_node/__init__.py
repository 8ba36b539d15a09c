"""Gravity map matching: batches of reduced readings to position fixes."""
