"""Read, build, guess and edit a rig: the TOML file in which a person describes sensor and surface."""

from palpate.setup.rig import Rig, check_rig, load_rig

__all__ = ["Rig", "check_rig", "load_rig"]
