"""Continuation: the same field at another height.

- `level`: from one level to another, upwards or, regularised, downwards; which fields can be
  continued.
- `blocks`: the same in blocks, with little memory, for maps with holes and maps of gravity.
- `terrain`: from the ground to a level, by sources below the ground.
- `source_layer`: the field of such sources, and the sources of a field, by Fourier transform.
"""
