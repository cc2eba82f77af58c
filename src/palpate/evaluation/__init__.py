"""Estimates against the truth: errors, coverage, tables."""
