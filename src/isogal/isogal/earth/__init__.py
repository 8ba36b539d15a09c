"""The Earth: GRS80 ellipsoid, normal gravity, Eötvös acceleration, frames, and a plane about a
point."""
