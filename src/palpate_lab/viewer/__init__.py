"""The laboratory's pages."""
