"""Fusion: the unscented filter that navigates, and the exact treatment of fixes that arrive
late."""
