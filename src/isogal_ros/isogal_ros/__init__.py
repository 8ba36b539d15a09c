"""What the Isogal nodes share: parameters, conversions, diagnostics, recorder, replayer,
launcher."""
