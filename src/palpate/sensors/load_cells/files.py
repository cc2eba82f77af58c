"""The tables of a model of load cells in a file, and its summary."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.contact.indentation import Indentation
from palpate.files.models.model import Lines, Model, span
from palpate.files.schema import Key, TableForm
from palpate.sensors.load_cells.model import AXES, LoadCells


def of_load_cells(cells: LoadCells) -> Lines:
    """Return the model's figures as a list of pairs (name, text)."""
    known = np.isfinite(cells.positions).all(axis=1)
    deviation = np.sqrt(np.diag(cells.inverse()[1]))
    wrench = f"{1e3 * deviation[:3].max():.2g} mN and {1e3 * deviation[3:].max():.2g} N mm"
    # k cells of S [N/V] share a force F, so that the lengths of their readings add up to F/S or a little more
    axes = [AXES.index(axis) for axis in cells.axes]
    sensitivity = 1.0 / np.linalg.norm(cells.matrix[:, axes].reshape(-1, len(axes), len(axes)), axis=1).sum(axis=0)
    along, law = ", ".join(f"{value:.3g}" for value in sensitivity), cells.indentation
    said = [
        ("cells", f"{cells.cells}, {'places known' if known.all() else f'places of {known.sum()} known'}"),
        ("noise", f"{span(np.sqrt(np.diag(cells.noise)))} V of a reading, {wrench} of the wrench"),
        ("range", _limits(cells.limits)),
        ("sensitivity", f"({along}) N/V a cell along {', '.join(cells.axes)}, roughly"),
        ("misfit", f"{100 * cells.misfit:.2g} % of a reading"),
        ("drift", f"of the zero: {cells.drift:.2g} standard deviations of a reading"),
        ("samples", f"{cells.samples:,}, {cells.correlation:.3g} of which tell as much as one independent sample"),
    ]
    if law is not None:
        said.append(("soft layer", f"indentation {1e3 * law.depth:.3f} mm at 1 N, growing as F^{law.exponent:.2f}"))
    return said


def _limits(limits: Float[np.ndarray, "m 2"]) -> str:
    known = np.asarray(np.isfinite(limits).all(axis=1))
    if not known.any():
        return "not known"
    low, high = limits[known].min(axis=0)[0], limits[known].max(axis=0)[1]
    said = f"{low:.4g} to {high:.4g} V"
    return said if known.all() else f"{said}, of {known.sum()} of {len(known)} channels"


LOAD_CELLS = Model(
    LoadCells,
    "a model of load cells",
    "Cells under a rigid frame: u = C (I + E) w + b.",
    "palpate calibrate load-cells",
    of_load_cells,
    {
        LoadCells: TableForm(
            {
                "drift": Key("of the zero after it was taken, in standard deviations of a reading", least=0.0),
                "misfit": Key("share of a reading that no wrench explains", least=0.0),
                "correlation": Key("samples that tell as much as one independent sample", least=1.0),
                "samples": Key("of the calibration", least=0.0),
                "axes": Key("of the surface's frame that each cell measures"),
                "shear": Key("of a touch, over its force, where it is not measured", least=0.0),
                "bias": Key("V, of each channel, in the calibration", required=True),
                "positions": Key("m, of the cells; nan: not known", unknown=True),
                "limits": Key("V, lowest and highest of each channel; inf: none", infinite=True, required=True),
                "matrix": Key("C: V/N and V/(N m), channel by channel, force first"),
                "noise": Key("V^2, covariance of one reading"),
                "covariance": Key("of E, row by row: 36 x 36", required=True),
            }
        ),
        Indentation: TableForm(
            {"depth": Key("m, at 1 N"), "exponent": Key("of the force"), "covariance": Key("of both")}
        ),
    },
)
