"""Reproductions of the papers, one folder a paper."""
