"""Draws values, decides nothing: the report and the page."""
