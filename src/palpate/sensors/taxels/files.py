"""Define the file formats of an intensity model and of taxel places."""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.files.models.model import Lines, Model, span
from palpate.files.schema import Key, TableForm
from palpate.sensors.taxels.intensity import Curve, Intensity
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.response import TaxelResponse

_UPPER = np.triu_indices(3)  # of a covariance: xx xy xz yy yz zz


def _curve(curve: Curve) -> dict[str, Any]:
    """Return the keys that a curve's kind does not use, without values."""
    optional = ["knots", *(each.name for each in fields(curve) if each.default is not MISSING)]
    return dict.fromkeys(name for name in optional if not np.any(getattr(curve, name)))


def _of_intensity(intensity: Intensity) -> Lines:
    """Return (name, text) pairs on the curves of a model."""
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
    _of_intensity,
    {
        Intensity: TableForm(
            {
                "which": Key("the curve of each cell, counted from 0"),
                "unit": Key(),
                "notes": Key(),
                "provenance": Key(),
            },
            called={"curves": "curve"},
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


def _response(gains: Float[np.ndarray, "k 9"], **rest: Any) -> TaxelResponse:
    return TaxelResponse(gains.reshape(-1, 3, 3), **rest)


def of_response(response: TaxelResponse) -> Lines:
    """Return (name, text) pairs on a response of taxels with three axes."""
    how = "sums of the taxels' loads" if response.sums else "fitted to the taxels' loads"
    warm = f"corrected to {response.temperature:.4g}; a kelvin takes {response.fade:.2%} from a reading"
    return [
        ("taxels", f"{len(response)}, {1e3 * response.pitch:.3g} mm apart"),
        ("forces", how),
        *([("temperature", warm)] if len(response.thermal) else []),
        *([("left out", response.provenance["left_out"])] if "left_out" in response.provenance else []),
    ]


RESPONSE = Model(
    TaxelResponse,
    "the response of taxels with three axes",
    "From readings of taxels with three axes to loads, and how a force spreads to them.",
    "palpate calibrate response",
    of_response,
    {
        TaxelResponse: TableForm(
            {
                "pitch": Key("m, the unit of lengths", least=1e-6),
                "gains": Key(
                    "a row a taxel: load [N] along x, y and into the body by the readings x, y, z, row by row"
                ),
                "shares": Key("of the Gaussians in A, B, C, G, H, see docs/skin_contacts.md"),
                "coupling": Key("of the same: what a taxel's readings hold of its neighbours' loads, taken off"),
                "misfit": Key("shares of the largest load, and of a taxel's own"),
                "patch": Key("squared pitches: a + b F^(2/3), deviation"),
                "curve": Key("normal c0 n + c1 n^2 + c2 t^2, tangential (c3 + c4 n) t"),
                "widening": Key("of the deviations of place, normal and tangential force"),
                "inexact": Key("more deviations of these: pitches, and shares of the force"),
                "unusual": Key("more deviations, for a shape of 1"),
                "usual_misfit": Key("misfits of the presses' loads, mean square", infinite=True),
                "sums": Key("forces are the sums of the taxels' loads"),
                "late": Key("s, share, deviation: how much of the loads before a reading follows"),
                "drift": Key("s, within which the rest is followed", infinite=True),
                "limits": Key("lowest and highest reading, of no weight", infinite=True),
                "temperature": Key("K or degrees C, to which readings are corrected"),
                "thermal": Key("counts taken off each reading by a kelvin more, once fade is made good"),
                "fade": Key("share of a reading that a kelvin more takes away"),
                "notes": Key(),
                "provenance": Key(),
            },
            _response,
            lambda response: {"gains": response.gains.reshape(-1, 9)},
        ),
    },
)


def _taxel_places(taxels: Float[np.ndarray, "k 15"], **rest: Any) -> TaxelPlaces:
    whole = taxels[:, 6:8]
    if not (np.isfinite(whole) & (whole == np.round(whole))).all() or (whole < (-1, 0)).any():
        raise ValueError("the module (-1: none) and the pokes of a taxel must be whole numbers")
    covariance = np.empty((len(taxels), 3, 3))
    covariance[:, _UPPER[0], _UPPER[1]] = covariance[:, _UPPER[1], _UPPER[0]] = taxels[:, 9:]
    known = covariance[np.isfinite(covariance).all(axis=(1, 2))]
    if len(known) and (np.linalg.eigvalsh(known)[:, 0] < -1e-6 * np.trace(known, axis1=1, axis2=2)).any():
        raise ValueError("the covariance of a taxel must not have a negative variance")
    module, pokes = whole.astype(np.int64).T
    return TaxelPlaces(taxels[:, :3], taxels[:, 3:6], covariance, module, pokes, taxels[:, 8], **rest)


def _taxel_places_keys(places: TaxelPlaces) -> dict[str, Any]:
    numbers, upper = (places.module, places.pokes, places.relative), places.covariance[:, _UPPER[0], _UPPER[1]]
    return {"taxels": np.column_stack([places.positions, places.normals, *numbers, upper])}


def of_taxels(places: TaxelPlaces) -> Lines:
    """Return (name, text) pairs on taxel places: taxels, modules, normals, and known deviations [mm]."""
    there, deviation = places.there, places.deviations()
    count, known = np.count_nonzero(there), np.isfinite(deviation) & there
    absent = f", {len(places) - count} numbers without one" if count < len(places) else ""
    loose = int(np.count_nonzero(there & (places.module < 0)))
    beside = f", and {loose} taxels on none" if loose and places.modules else ""
    facing = np.count_nonzero(np.isfinite(places.normals).all(axis=1) & there)
    said = [
        ("taxels", f"{count:,}{absent}"),
        ("modules", f"{len(np.unique(places.module[there & (places.module >= 0)]))}{beside}"),
        ("normals", "known" if facing == count else f"of {facing:,} known" if facing else "not known"),
    ]
    if places.pokes.any():
        said.append(("touched", f"{np.count_nonzero(places.pokes[there]):,} of {count:,}"))
    if known.any():
        said.append(("deviation", _mean_worst(deviation[known])))
    if np.isfinite(places.relative[there]).any():
        said.append(("relative", f"{_mean_worst(places.relative[there])}, once one rigid motion is taken off"))
    if np.isfinite(places.reach):
        said.append(("reach", f"{1e3 * places.reach:.2f} mm of a response"))
    return said


def _mean_worst(values: Float[np.ndarray, " n"]) -> str:
    return f"{1e3 * float(np.nanmean(values)):.2f} mm mean, {1e3 * float(np.nanmax(values)):.2f} mm worst"


TAXELS = Model(
    TaxelPlaces,
    "places of taxels",
    "Where each taxel of a skin sits, in the link's frame.",
    "palpate calibrate taxels",
    of_taxels,
    {
        TaxelPlaces: TableForm(
            {
                "reach": Key("m, deviation of a response over the distance of the poke", least=0.0),
                "noise": Key("N, N m: deviations of the wrench of a poke"),
                "notes": Key(),
                "configurations": Key("of the arm: link in the sensor's frame, x y z [m], quaternion x y z w; pokes"),
                "taxels": Key(
                    "a row a taxel: x y z [m], nx ny nz outward, module (-1: none), pokes it answered to, "
                    "deviation [m] once one rigid motion is taken off, covariance xx xy xz yy yz zz [m^2]; "
                    "nan: not known, no taxel",
                    unknown=True,
                ),
                "provenance": Key(),
            },
            _taxel_places,
            _taxel_places_keys,
        ),
    },
)
