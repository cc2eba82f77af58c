"""Define the file format of an intensity model."""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import Any

import numpy as np
from jaxtyping import Int

from palpate.files.models.model import Lines, Model, span
from palpate.files.schema import Key, TableForm
from palpate.sensors.taxels.intensity import Curve, Intensity

__all__ = ["INTENSITY", "of_intensity"]


def _curve(curve: Curve) -> dict[str, Any]:
    """Return the keys of a curve without those that its kind does not use: a sheet has a curve for each cell."""
    optional = {each.name for each in fields(curve) if each.default is not MISSING} | {"knots"}
    stated = {each.name: getattr(curve, each.name) for each in fields(curve)}
    return {name: value for name, value in stated.items() if name not in optional or np.any(value)}


def _intensity(
    curve: tuple[Curve, ...],
    which: Int[np.ndarray, "rows columns"] | Int[np.ndarray, " k"] | None = None,
    **rest: Any,
) -> Intensity:
    return Intensity(curve, which, **rest)


def _intensity_keys(intensity: Intensity) -> dict[str, Any]:
    keys = {name: getattr(intensity, name) for name in ("unit", "which", "notes", "provenance")}
    return keys | {"curve": intensity.curves}


def of_intensity(intensity: Intensity) -> Lines:
    """Return (name, text) pairs on a model: curves, range and residual, and where known saturation and hysteresis."""
    curves, which = intensity.curves, intensity.which
    kinds = ", ".join(dict.fromkeys(curve.name for curve in curves))
    sheet = "the same for all cells" if which is None else f"for {' x '.join(map(str, which.shape))} cells"
    top = np.array([curve.saturation for curve in curves])
    lag = np.array([curve.hysteresis for curve in curves])
    unit = intensity.unit
    falling = "; readings fall under load" if curves[0].falling else ""
    said = [
        ("curves", f"{len(curves)}, {kinds}, {sheet}"),
        ("range", f"{span(np.array([curve.largest for curve in curves]))} N{falling}"),
        ("residual", f"{span(np.array([curve.residual for curve in curves]))} {unit} rms"),
    ]
    if np.isfinite(top).any():
        said.append(("saturated", f"at {span(top[np.isfinite(top)])} {unit}"))
    if np.isfinite(lag).any():
        said.append(("hysteresis", f"{span(100 * lag[np.isfinite(lag)])} % of the span"))
    return said


INTENSITY = Model(
    Intensity,
    "an intensity model",
    "From readings of taxels to forces.",
    "palpate calibrate intensity",
    of_intensity,
    {
        Intensity: TableForm(
            {
                "which": Key("the curve of each cell, counted from 0"),
                "unit": Key(),
                "notes": Key(),
                "provenance": Key(),
            },
            _intensity,
            _intensity_keys,
        ),
        Curve: TableForm(
            {
                "kind": Key(),
                "parameters": Key("see docs/skin_contacts.md; N and counts"),
                "covariance": Key("of the parameters"),
                "largest": Key("N, up to which it was measured"),
                "saturation": Key("reading at the end of the range", infinite=True),
                "falling": Key("the reading falls as the force grows"),
                "joint": Key("N, where the two ranges meet"),
                "knots": Key("N"),
                "residual": Key("counts, rms of the fit"),
                "hysteresis": Key("between loading and unloading, as a share of the span"),
            },
            spell=_curve,
        ),
    },
)
