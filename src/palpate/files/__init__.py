"""Read and write files: logs, tables, contacts, models, robot descriptions."""

from palpate.files.arm import load_arm

__all__ = ["load_arm"]
