"""Read and write MCAP files: a reader, a writer of rows of structured arrays, and recovery of damaged files."""
