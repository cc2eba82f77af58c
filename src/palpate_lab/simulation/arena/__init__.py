"""Simulate robots with a soft skin on a field with walls and boxes, in a physics engine."""
