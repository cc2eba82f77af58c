"""Fuzzing of what Palpate reads, led by coverage: `make fuzz`."""
