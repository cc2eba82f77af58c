"""Simulate robots with many sensors on links that move: touches of all of them, with their ground truth."""
