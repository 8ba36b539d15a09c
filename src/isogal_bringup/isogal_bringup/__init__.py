"""Launch file, parameters and viewer layouts of the Isogal graph."""
