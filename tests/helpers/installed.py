"""Packages that a test installs for itself."""

from isogal import plugins


def forget_plugins() -> None:
    """Let the names of plugins be looked up anew: what is installed has changed."""
    plugins._installed.cache_clear()
    plugins._registered.cache_clear()
