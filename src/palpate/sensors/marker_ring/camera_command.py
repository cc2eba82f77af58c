"""`palpate calibrate camera`: identify the lens of a fisheye camera from pictures of a chessboard."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import arg

from palpate.console.calibration import Calibration, CalibrationResult
from palpate.console.options import Log, Output, require_positive
from palpate.errors import InputError
from palpate.files.logs import open_log
from palpate.files.logs.layout import ImageChannel, LogLayout
from palpate.sensors.marker_ring.calibrate_camera import calibrate_board
from palpate.sensors.marker_ring.files import of_camera
from palpate.signals.recording import IMAGE

__all__ = ["CalibrateCamera"]

_MOST = 40  # pictures, evenly spread: more add no information


@dataclass(frozen=True)
class CalibrateCamera(Calibration):
    """Calibrate a fisheye lens from pictures of a chessboard.

    Calibrate a fisheye lens from pictures of a chessboard, held at all angles and to the edges of the picture.

    Args:
        log: folder of pictures, or a video.
        output: camera.toml to write.
        board: inner corners of the board, columns and rows.
        square: side of one of its squares [m].
    """

    log: Log
    output: Output
    board: Annotated[str, arg(metavar="CxR")] = "9x6"
    square: Annotated[float, arg(metavar="METRES")] = 0.01

    def identify(self) -> CalibrationResult:
        """Find the board in the pictures and fit the lens to its corners; return a `CalibrationResult` with it.

        Raises:
            InputError: `board` or `square` is invalid, the log has no images that can be read, fewer than three show
                the board, they do not determine a lens, or OpenCV is missing.
        """
        columns, _, rows = self.board.lower().partition("x")
        if not (columns.isdigit() and rows.isdigit() and int(columns) > 2 and int(rows) > 2):
            hint = "Write the numbers of its inner corners, as 9x6."
            raise InputError(f"must be the size of a board, not {self.board!r}.", where="--board", hint=hint)
        require_positive(self.square if np.isfinite(self.square) else np.nan, "--square")
        pictures, count = _pictures(self.log)
        fit = calibrate_board([frame for _, frame in pictures], (int(columns), int(rows)), self.square)
        hidden = len(pictures) - len(fit.used) - len(fit.far)
        return CalibrationResult(
            [
                *of_camera(fit.camera),
                ("deviation", f"{fit.deviation * fit.validation.widening**0.5:.2g} px/rad of the focal length"),
                ("corners", f"{fit.residual:.2g} px rms, in {len(fit.used)} of {count} pictures"),
                ("left out", str(fit.validation)),
            ],
            fit.camera,
            notes=[
                *([f"{hidden} of {len(pictures)} pictures do not show the complete board"] if hidden else []),
                *fit.validation.notes,
            ],
            warnings=[f"picture {pictures[k][0]} contradicts the others and is not used" for k in fit.far],
            next=[f'name it in the rig: camera = "{self.output.name}" under [marker_ring]'],
        )


def _pictures(path: Path) -> tuple[list[tuple[int, np.ndarray]], int]:
    """Return at most 40 pictures, evenly spread, with their numbers from 1, and the number of all pictures."""
    log = open_log(path, LogLayout(wrench=None, images=ImageChannel()))
    kept, stride, count = list[tuple[int, np.ndarray]](), 1, 0
    for block in log.blocks():
        for frame in block.channels[IMAGE]:
            if count % stride == 0:
                kept.append((count + 1, frame))
            count += 1
            if len(kept) > 2 * _MOST:
                kept, stride = kept[::2], 2 * stride
    return kept[:: -(-len(kept) // _MOST) or 1], count
