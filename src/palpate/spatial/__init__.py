"""Where things are, what pushes on them, and how sure."""
