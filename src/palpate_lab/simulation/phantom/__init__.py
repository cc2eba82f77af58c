"""Simulate a robot's probe on a soft phantom that moves: arm, probes, tissue, motions and physics."""
