"""Matching a rigid track with its noise integrated out (docs/mathematics.md, section 10.2).

A track whose shape is right is known but for a shift. Its posterior is computed on a grid of
shifts for many noise models at once, which are summed over with the weight that the readings give
each; then the fix is made again without each half of the track, to see what its error bars are
worth.

- `continued_map`: what has a map beyond its edge and in its gaps, and how well is it known there?
- `readings`: residuals of a batch at many shifts.
- `noise_models`: which errors of map and readings are possible, with which prior?
- `evidence`: log-likelihood of residuals under many noise models.
- `search`: the posterior on a grid that is refined where it matters.
- `jackknife`: error bars that do not rest on the noise models alone.
- `estimates`: what the batch says of sigma, correlation length and offset.
- `matcher`: from a batch to a fix, as a `isogal.matching.interfaces.Matcher`.
"""
