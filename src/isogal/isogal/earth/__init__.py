"""The Earth: GRS80 ellipsoid, normal gravity, Eötvös acceleration, frames."""
