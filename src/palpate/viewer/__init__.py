"""Draw results as reports, interactive pages and films; nothing is estimated here."""
