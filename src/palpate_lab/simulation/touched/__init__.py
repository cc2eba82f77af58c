"""Simulate a forearm with a taxel skin and a force/torque sensor, touched at several places, in a physics engine."""
