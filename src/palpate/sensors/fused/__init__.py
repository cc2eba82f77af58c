"""A skin and a force/torque sensor on one link."""
