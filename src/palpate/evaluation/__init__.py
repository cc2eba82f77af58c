"""Compare estimates with the ground truth: errors, coverage, tables."""
