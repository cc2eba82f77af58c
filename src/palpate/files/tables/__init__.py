"""Delimited text: lines, fields and numbers, every row accounted for."""
