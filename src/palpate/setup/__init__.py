"""Read, build, guess and edit a rig: the TOML file in which a person describes sensor and surface."""

from palpate.setup.load import load_rig
from palpate.setup.rig import Rig, check_rig

__all__ = ["Rig", "check_rig", "load_rig"]
