"""A zero that wanders: what is followed, what is not eaten, and what nobody can tell."""
