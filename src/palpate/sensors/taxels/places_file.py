"""Define the file format of taxel places."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.files.models.model import Lines, Model
from palpate.files.schema import Key, TableForm
from palpate.sensors.taxels.places import TaxelPlaces

__all__ = ["TAXELS", "of_taxels"]


_UPPER = np.triu_indices(3)  # of a covariance: xx xy xz yy yz zz


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
    table = np.column_stack([places.positions, places.normals, *numbers, upper])
    same = ("reach", "noise", "notes", "configurations", "provenance")
    return {name: getattr(places, name) for name in same} | {"taxels": table}


def of_taxels(places: TaxelPlaces) -> Lines:
    """Return (name, text) pairs on taxel places: taxels, modules, normals, and what is known of their errors."""
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
