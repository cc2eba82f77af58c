"""Read and write files: logs, tables, contacts, models, robot descriptions."""
