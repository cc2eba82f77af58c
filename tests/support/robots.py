"""Sessions of simulated robots that are made in seconds."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate.cli import main


def small_hand(folder: Path) -> Path:
    """A hand for eight seconds, with five fingertips, roughly calibrated pads and ten touches."""
    options = ("--seconds", "8", "--touches", "10", "--free", "6", "--seed", "5", "-o", str(folder))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("palpate_lab.cli.robot_models._PRESSES", 40)
        assert main(["simulate", "hand", *options]) == 0
    return folder
