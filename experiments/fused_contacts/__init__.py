"""Several contacts at once from a skin and a force/torque sensor, beside the skin alone and minimum norm."""
