"""How the zero of a sensor wanders: found from a free log, and followed."""
