"""Map matching: batches of readings against a map give fixes."""
