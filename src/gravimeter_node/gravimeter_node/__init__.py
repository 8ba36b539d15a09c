"""Simulated gravimeter and its reductions with the navigator's estimate."""
