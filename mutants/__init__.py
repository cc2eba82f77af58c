"""Faults put into Palpate on purpose, to see whether the tests of their own room notice: `make mutants`."""
