"""`palpate calibrate camera`: the lens of a fisheye camera, from pictures of a chessboard."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import arg

from palpate.calibration.ring_camera import calibrate_board
from palpate.cli.console import lines, note, title
from palpate.cli.options import Log, Output
from palpate.errors import InputError
from palpate.io.atomic import keep_inputs
from palpate.io.logs import open_log
from palpate.io.logs.layout import ImageChannel, Layout
from palpate.io.models import write_model
from palpate.io.models.camera import of_camera
from palpate.sensors.recording import IMAGE

__all__ = ["calibrate_camera"]

_MOST = 40  # pictures, evenly spread: more tell nothing new


def calibrate_camera(
    pictures: Log,
    /,
    output: Output,
    board: Annotated[str, arg(metavar="CxR")] = "9x6",
    square: Annotated[float, arg(metavar="METRES")] = 0.01,
) -> None:
    """Calibrate a fisheye lens from pictures of a chessboard, held at all angles and to the edges of the picture.

    Args:
        pictures: folder of pictures, or a video.
        output: camera.toml to write.
        board: inner corners of the board, columns and rows.
        square: side of one of its squares [m].
    """
    keep_inputs(output, (pictures,))
    columns, _, rows = board.lower().partition("x")
    if not (columns.isdigit() and rows.isdigit() and int(columns) > 2 and int(rows) > 2):
        raise InputError(f"{board!r} is no size of a board.", where="--board", hint="Write its inner corners as 9x6.")
    if not 0 < square < np.inf:
        raise InputError("must be positive.", where="--square")
    fit = calibrate_board(_pictures(pictures), (int(columns), int(rows)), square)
    write_model(output, fit.camera)
    title(f"{pictures} -> {output}")
    lines([*of_camera(fit.camera), ("corners", f"{fit.residual:.2g} px rms, in {fit.pictures} pictures")])
    note([f'name it in the rig: camera = "{output.name}" under [marker_ring]'])


def _pictures(path: Path) -> list[np.ndarray]:
    """At most 40, evenly spread."""
    log = open_log(path, Layout(wrench=None, images=ImageChannel()))
    kept, stride, count = list[np.ndarray](), 1, 0
    for block in log.blocks():
        for frame in block.channels[IMAGE]:
            if count % stride == 0:
                kept.append(frame)
            count += 1
            if len(kept) > 2 * _MOST:
                kept, stride = kept[::2], 2 * stride
    return kept[:: max(1, len(kept) // _MOST)]
