"""Read a fisheye lens from a file: of `palpate calibrate camera`, or the camera YAML of ROS or OpenCV."""

from __future__ import annotations

from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, cast

from palpate.errors import InputError, importing_extra
from palpate.files.models import load_toml, read_model
from palpate.files.schema import parse
from palpate.optical.fisheye import Fisheye

_YAML = (".yaml", ".yml")
_MODELS = ("equidistant", "fisheye", "kannala_brandt4")
_NAMES = (("camera_matrix", 9), ("distortion_coefficients", 4), ("image_width", 1), ("image_height", 1))


def read_lens(path: Path) -> Fisheye:
    """Return the lens in a model file, in a TOML table with the same keys, or in a camera YAML of ROS or OpenCV.

    Raises:
        InputError: the file cannot be read, a key is missing or has the wrong size, or the lens is no fisheye.
    """
    if path.suffix.lower() in _YAML:
        return _of_yaml(path)
    table = load_toml(path)
    return read_model(path, Fisheye) if "kind" in table else parse(table, Fisheye, file=str(path))


def _of_yaml(path: Path) -> Fisheye:
    where, table = str(path), _table(path)
    model = table.get("distortion_model", "fisheye" if table.get("fisheye_model") == 1 else None)
    if model not in _MODELS:
        what = f"states the distortion model {model!r}, and a lens here is a fisheye: {', '.join(_MODELS)}."
        hint = "Calibrate it by `palpate calibrate camera`, or add `distortion_model: equidistant` if cv2.fisheye did."
        raise InputError(what, where=where, hint=hint)
    values = {name: _numbers(table.get(name)) for name, _ in _NAMES}
    wrong = [f"{name} ({size})" for name, size in _NAMES if len(values[name]) != size]
    if wrong:
        raise InputError(f"lacks these keys, or they have another number of values: {', '.join(wrong)}.", where=where)
    (fx, _, cx, _, fy, cy, *_), (k1, k2, k3, k4), (width,), (height,) = values.values()
    return Fisheye(fx, fy, cx, cy, k1, k2, k3, k4, int(width), int(height))


def _table(path: Path) -> dict[str, Any]:
    with importing_extra("a camera's YAML needs PyYAML", "camera"):
        import yaml

    class Loader(yaml.SafeLoader):
        """Load plain values, and OpenCV's matrices as tables."""

    for name in ("opencv-matrix", "opencv-nd-matrix"):
        Loader.add_constructor(f"tag:yaml.org,2002:{name}", partial(Loader.construct_mapping, deep=True))
    try:
        lines = path.read_text().splitlines()
        table = yaml.load("\n".join(line for line in lines if not line.startswith("%YAML")), Loader)
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as problem:
        raise InputError("cannot be read as a camera's YAML.", where=str(path)) from problem
    return cast("dict[str, Any]", table) if isinstance(table, dict) else {}


def _numbers(value: Any) -> list[float]:
    """Return the numbers of a value, or of a matrix's data in row-major order."""
    data: Any = cast("dict[str, Any]", value).get("data") if isinstance(value, dict) else value
    listed = cast("list[Any]", data) if isinstance(data, list) else [data]
    return [float(each) for each in listed if isinstance(each, int | float) and isfinite(each)]
