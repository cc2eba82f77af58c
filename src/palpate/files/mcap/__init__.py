"""MCAP files: one reader, one writer of rows of structured arrays, and what is whole of a file that was torn."""
