"""Monte Carlo: many runs as one array computation, spread over workers, kept on disk."""
