"""Estimate contacts live: sources of samples, the ring of samples and contacts, and the processes that read it."""
