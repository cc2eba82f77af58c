"""Film the lab without a screen, by the physics engine's renderer."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import InputError
from palpate.opencv import opencv
from palpate.viewer.video import Video
from palpate_lab.simulation.engine import engine
from palpate_lab.simulation.phantom.lab import PhantomLab

RATE = 25  # pictures a second
SIZE = (960, 720)
_TRY = "import mujoco; mujoco.GLContext(64, 64).make_current()"


def choose_renderer() -> None:
    """Choose MuJoCo's renderer before MuJoCo is first imported: it reads MUJOCO_GL then, and never again.

    The choice, set as MUJOCO_GL in the environment, is off-screen drawing by the graphics card's driver (egl), else by
    the processor (osmesa); a MUJOCO_GL that is set is kept. Each is tried in a separate process, because one that is
    not installed fails in many ways.

    Raises:
        InputError: none works.
    """
    if "mujoco" in sys.modules or "MUJOCO_GL" in os.environ:
        return
    engine_environment = dict(os.environ)
    for kind in ("egl", "osmesa"):
        engine_environment["MUJOCO_GL"] = kind
        tried = subprocess.run([sys.executable, "-c", _TRY], env=engine_environment, capture_output=True, check=False)
        if tried.returncode == 0:
            os.environ["MUJOCO_GL"] = kind
            return
    raise _no_picture()


def _no_picture() -> InputError:
    return InputError(
        "needs EGL or OSMesa to draw without a screen, and neither works here.",
        where="--film",
        hint="Install libegl1 or libosmesa6, or set MUJOCO_GL to what the system has.",
    )


class Film:
    """A video of a lab, picture by picture; a context manager.

    Args:
        lab: lab to draw.
        path: path of the video (.mp4).

    Raises:
        InputError: OpenCV or MuJoCo is not installed, nothing can draw, or no video can be written.
    """

    def __init__(self, lab: PhantomLab, path: Path) -> None:
        self._cv2, self._lab, mujoco = opencv(), lab, engine("moving phantom")
        try:
            self._renderer: Any = mujoco.Renderer(lab.model, SIZE[1], SIZE[0])
        except Exception as problem:  # whatever the platform's GL raises
            raise _no_picture() from problem
        self._camera = mujoco.MjvCamera()
        x, y, z = lab.settings.place
        self._camera.lookat[:] = (0.75 * x, y, z + 0.10)
        self._camera.distance, self._camera.azimuth, self._camera.elevation = 0.95, 120.0, -12.0
        try:
            self._video = Video(path, SIZE, RATE)
        except InputError:
            self._renderer.close()
            raise

    def add(self, words: str) -> None:
        """Add to the video a picture of the lab as it is now, with a line of text."""
        self._renderer.update_scene(self._lab.data, self._camera)
        picture = np.ascontiguousarray(self._renderer.render()[:, :, ::-1])
        cv2 = self._cv2
        cv2.putText(picture, words, (20, 40), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (48, 37, 27), 2, cv2.LINE_AA)
        self._video.add(picture)

    def __enter__(self) -> Film:
        return self

    def __exit__(self, *_: object) -> None:
        self._video.close()
        self._renderer.close()
