"""Timings side by side in one run: `python -m benchmarks` writes benchmarks/RESULTS.md."""
