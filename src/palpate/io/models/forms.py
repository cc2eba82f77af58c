"""How models stand in files: comments and bounds of their keys, and what is spelled otherwise than field by field."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.io.schema import Form, Key
from palpate.sensors.fisheye import Fisheye, RingView
from palpate.sensors.force_torque import Payload
from palpate.sensors.intensity import Curve, Intensity
from palpate.sensors.load_cells import Indentation, LoadCells
from palpate.sensors.marker_ring import MarkerRing
from palpate.sensors.markers import MarkerColour
from palpate.sensors.ring_response import RingResponse
from palpate.sensors.skin_map import SkinMap
from palpate.sensors.taxel_places import TaxelPlaces
from palpate.spatial.pose import Pose
from palpate.surfaces.bspline import BSplineSurface

__all__ = ["FORMS"]


def _curve(curve: Curve) -> dict[str, Any]:
    """Without what does not concern its kind: a sheet has a curve for each cell."""
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


def _spline(shape: tuple[int, int], control: Float[np.ndarray, "n 3"], **rest: Any) -> BSplineSurface:
    if min(shape) < 0 or len(control) != shape[0] * shape[1]:
        raise ValueError(f"control must have {shape[0]} x {shape[1]} points, not {len(control)}")
    return BSplineSurface(control=control.reshape(*shape, 3), **rest)


def _spline_keys(surface: BSplineSurface) -> dict[str, Any]:
    keys = {each.name: getattr(surface, each.name) for each in fields(surface)}
    return keys | {"shape": surface.control.shape[:2], "control": surface.control.reshape(-1, 3)}


def _skin_map(
    rows: int,
    columns: int,
    cells: Float[np.ndarray, "n 9"],
    overlap: Bool[np.ndarray, " o"] | None = None,
    surface: BSplineSurface | None = None,
    **rest: Any,
) -> SkinMap:
    shape = (rows, columns)
    if min(shape) < 1 or len(cells) != rows * columns:
        raise ValueError(f"cells must be {rows} x {columns} rows of 9 numbers")
    if overlap is not None and len(overlap) not in (0, len(cells)):
        raise ValueError(f"overlap must be {len(cells)} times true or false")
    table = cells.reshape(*shape, 9)
    if surface is not None:
        rest |= {"surface": surface, "uv": table[..., 7:]}
    if overlap is not None and len(overlap):
        rest["overlap"] = overlap.reshape(shape)
    return SkinMap(table[..., :3], table[..., 3:6], table[..., 6], **rest)


def _skin_map_keys(skin: SkinMap) -> dict[str, Any]:
    uv = np.zeros((*skin.areas.shape, 2)) if skin.surface is None else skin.uv
    table = np.concatenate([skin.centres, skin.normals, skin.areas[..., None], uv], axis=-1)
    same = ("rows", "columns", "pitch", "strain", "distance", "notes", "surface", "provenance")
    return {name: getattr(skin, name) for name in same} | {
        "cells": table.reshape(-1, 9),
        "overlap": skin.overlap.reshape(-1),
    }


_UPPER = np.triu_indices(3)  # of a covariance: xx xy xz yy yz zz


def _taxel_places(taxels: Float[np.ndarray, "k 15"], **rest: Any) -> TaxelPlaces:
    whole = taxels[:, 6:8]
    if not (np.isfinite(whole) & (whole == np.round(whole))).all() or (whole < (-1, 0)).any():
        raise ValueError("the module (-1: none) and the pokes of a taxel must be whole numbers")
    covariance = np.empty((len(taxels), 3, 3))
    covariance[:, _UPPER[0], _UPPER[1]] = covariance[:, _UPPER[1], _UPPER[0]] = taxels[:, 9:]
    known = covariance[np.isfinite(covariance).all(axis=(1, 2))]
    if len(known) and (np.linalg.eigvalsh(known)[:, 0] < -1e-6 * np.trace(known, axis1=1, axis2=2)).any():
        raise ValueError("some covariance of a taxel has a negative variance")
    module, pokes = whole.astype(np.int64).T
    return TaxelPlaces(taxels[:, :3], taxels[:, 3:6], covariance, module, pokes, taxels[:, 8], **rest)


def _taxel_places_keys(places: TaxelPlaces) -> dict[str, Any]:
    numbers = [places.module, places.pokes, places.relative]
    table = [places.positions, places.normals, *(each[:, None] for each in numbers)]
    table = np.concatenate([*table, places.covariance[:, _UPPER[0], _UPPER[1]]], axis=1)
    same = ("reach", "noise", "notes", "configurations", "provenance")
    return {name: getattr(places, name) for name in same} | {"taxels": table}


def _marker_ring(
    radius: float,
    inner: float,
    camera: Fisheye,
    pose: Float[np.ndarray, "3 4"],
    markers: Float[np.ndarray, "m 4"],
    rings: tuple[float, ...] = (0.0,),
    **rest: Any,
) -> MarkerRing:
    view = RingView(camera, Pose(pose[:, :3], pose[:, 3]), inner, markers[:, 3].copy(), rings)
    return MarkerRing(radius, view, rest=markers[:, :2], area=markers[:, 2], **rest)


def _marker_ring_keys(ring: MarkerRing) -> dict[str, Any]:
    view, same = ring.view, ("radius", "jitter", "notes", "colour", "response", "provenance")
    pose = np.concatenate([view.pose.rotation, view.pose.translation[:, None]], axis=1)
    table = np.concatenate([ring.rest, ring.area[:, None], view.angles[:, None]], axis=1)
    own: dict[str, Any] = {"inner": view.radius, "camera": view.camera, "pose": pose, "markers": table}
    if len(view.rings) > 1:
        own["rings"] = tuple(view.rings.tolist())
    return {name: getattr(ring, name) for name in same} | own


def _ring_response(shape: tuple[int, int, int], coefficients: Float[np.ndarray, "n k"], **rest: Any) -> RingResponse:
    if min(shape) < 1 or coefficients.shape[1] != shape[2] or len(coefficients) % (shape[0] * 2 * shape[1]):
        raise ValueError(f"coefficients must be {shape[0]} x 2 x {shape[1]} rows of {shape[2]} numbers for each ring")
    return RingResponse(coefficients.reshape(shape[0], -1, shape[1], shape[2]), **rest)


def _ring_response_keys(response: RingResponse) -> dict[str, Any]:
    b, _, k, m = response.coefficients.shape
    keys = {each.name: getattr(response, each.name) for each in fields(response)}
    return keys | {"shape": (b, k, m), "coefficients": response.coefficients.reshape(-1, m)}


FORMS: Mapping[type, Form] = {
    MarkerRing: Form(
        {
            "radius": Key("m, of the skin's outer surface at the markers"),
            "inner": Key("m, of the markers"),
            "jitter": Key("px, deviation of a marker's place from frame to frame"),
            "notes": Key(),
            "pose": Key("of the camera in the ring: rotation, and place [m] in the last column"),
            "markers": Key("a row a marker at rest: x y [px], area [px], angle [rad]"),
            "rings": Key("m, heights of the rings of markers, towards the camera; as many rows of markers each"),
            "colour": Key(),
            "camera": Key(),
            "response": Key(),
            "provenance": Key(),
        },
        _marker_ring,
        _marker_ring_keys,
    ),
    Fisheye: Form(
        {
            "fx": Key("px/rad at the centre"),
            "cx": Key("px, of the principal point"),
            "k1": Key("of the angle's powers [Kannala-Brandt], as OpenCV's fisheye model has them"),
            "width": Key("px, of the image"),
        }
    ),
    MarkerColour: Form(
        {
            "score": Key("of a pixel: red, green, blue, bright, dark"),
            "threshold": Key("share of the way from the skin's score to the markers'"),
            "coverage": Key("share of the image that markers cover"),
            "background": Key("px, side of the square whose mean is subtracted; 0: none"),
        }
    ),
    RingResponse: Form(
        {
            "width": Key("m/N, mean and deviation of the depth of a newton"),
            "misfit": Key("m/N, left unexplained outwards and along, in equal parts of a turn from the contact on"),
            "spread": Key("rad, share of the force: deviations on touches that were not fitted"),
            "largest": Key("m, N: up to which it was calibrated"),
            "usual": Key("before anything is known: mean and deviation of the width z, deviation of shear / force"),
            "grip": Key("shear / force up to which it was calibrated", least=0.0),
            "dragged": Key(
                "share of dragged presses, deviations of shear / force of plain and of dragged; 0: one kind"
            ),
            "shape": Key("of the coefficients: v0 v1 v2 (s), terms of the angle from the contact, of the contact's"),
            "coefficients": Key("m/N, rows: v0 v1 v2 (s), each outwards, then along"),
        },
        _ring_response,
        _ring_response_keys,
    ),
    Payload: Form(
        {
            "weight": Key("N, in the base frame", required=True),
            "force_bias": Key("N, in the sensor's frame, as all that follows", required=True),
            "center_of_mass": Key("m", required=True),
            "torque_bias": Key("N m", required=True),
            "magnitude": Key("m/s^2, of gravity: mass is |weight| over it"),
            "residual": Key("N, N m: rms of the fit", least=0.0, required=True),
            "samples": Key("that were used", least=0.0),
            "covariance": Key("of weight, force_bias, center_of_mass, torque_bias, in this order", required=True),
        }
    ),
    LoadCells: Form(
        {
            "drift": Key("of the zero after it was taken, in standard deviations of a reading", least=0.0),
            "misfit": Key("share of a reading that no wrench explains", least=0.0),
            "correlation": Key("samples that tell as much as one independent sample", least=1.0),
            "samples": Key("of the calibration", least=0.0),
            "bias": Key("V, of each channel, in the calibration", required=True),
            "positions": Key("m, of the cells; nan: not known", unknown=True),
            "limits": Key("V, lowest and highest of each channel; inf: none", infinite=True, required=True),
            "matrix": Key("C: V/N and V/(N m), channel by channel, force first"),
            "noise": Key("V^2, covariance of one reading"),
            "covariance": Key("of E, row by row: 36 x 36", required=True),
        }
    ),
    Indentation: Form({"depth": Key("m, at 1 N"), "exponent": Key("of the force"), "covariance": Key("of both")}),
    Intensity: Form(
        {"which": Key("the curve of each cell, counted from 0"), "unit": Key(), "notes": Key(), "provenance": Key()},
        _intensity,
        _intensity_keys,
    ),
    Curve: Form(
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
    SkinMap: Form(
        {
            "rows": Key(),
            "columns": Key(),
            "pitch": Key("m, between rows and between columns"),
            "strain": Key("rms, and the one farthest from 0"),
            "distance": Key("m, of spline and mesh: mean, worst"),
            "notes": Key(),
            "cells": Key("row by row: x y z [m], nx ny nz outward, area [m^2], u v of the surface"),
            "overlap": Key(),
            "surface": Key(),
            "provenance": Key(),
        },
        _skin_map,
        _skin_map_keys,
    ),
    TaxelPlaces: Form(
        {
            "reach": Key("m, deviation of a response over the distance of the poke", least=0.0),
            "noise": Key("N, N m: deviations of the wrench of a poke"),
            "notes": Key(),
            "configurations": Key("of the arm: link in the sensor's frame, x y z [m], quaternion x y z w; pokes"),
            "taxels": Key(
                "a row a taxel: x y z [m], nx ny nz outward, module (-1: none), pokes it answered to, deviation [m] "
                "once one rigid motion is taken off, covariance xx xy xz yy yz zz [m^2]; nan: not known, no taxel",
                unknown=True,
            ),
            "provenance": Key(),
        },
        _taxel_places,
        _taxel_places_keys,
    ),
    BSplineSurface: Form(
        {
            "degree": Key("in u and in v", required=True),
            "periodic": Key("in v: the last control points of rows repeat the first", required=True),
            "shape": Key("of the control points, v fastest"),
            "knots_u": Key(),
            "knots_v": Key(),
            "control": Key("m"),
        },
        _spline,
        _spline_keys,
    ),
}
