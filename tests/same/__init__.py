"""Play the same commands on this checkout and on another commit, and compare what they answer: `make same`."""
