"""The rig: one TOML that a person writes, what it builds, and how it is guessed and edited."""

from palpate.setup.rig import Rig, check_rig, load_rig

__all__ = ["Rig", "check_rig", "load_rig"]
