"""Live: sources of samples, the ring that they and their contacts pass through, and what reads it."""
