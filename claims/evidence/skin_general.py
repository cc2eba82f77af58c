"""The least strain of a sheet by a general optimiser: scipy's trust region with a numerical Jacobian, no geodesics.

The surface's parameters are a spline over the sheet: bilinear, which is another discretisation than ours, or cubic,
which is ours. Green strain at 2 x 2 Gauss points of every square. It starts from straight lines in the parameters.
"""

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import least_squares
from scipy.sparse import csr_array, kron, vstack

_PIN = 1e3


def general(surface, start, heading, size, cells, per_cell: int = 2, degree: int = 1, held: int = 2) -> float:
    """The rms principal strain.

    Arguments as `palpate.sensors.taxels.skin_map.lay`; the corner is held, and the point `held` cells along the first
    edge may not leave the geodesic along the heading, which is found by scipy's ODE solver.
    """
    start = np.asarray(start)
    at = surface.derivatives(start)
    normal = np.cross(at[1], at[2])
    normal /= np.linalg.norm(normal)
    along = heading - normal * (heading @ normal)
    along /= np.linalg.norm(along)
    x_uv, y_uv = (np.linalg.lstsq(at[1:3].T, way, rcond=None)[0] for way in (along, np.cross(normal, along)))
    (by, dy, gy), (bx, dx, gx) = (_bases(side, n * per_cell, degree) for side, n in zip(size, cells, strict=True))
    reach = held * size[1] / cells[1]
    target, side = _geodesic(surface, start, x_uv, reach)
    end = surface.derivatives(target)[0]
    share = BSpline(*_knots(size[1], cells[1] * per_cell, degree))(reach)
    guess = start + gx[None, :, None] * x_uv + gy[:, None, None] * y_uv
    shape = guess.shape

    def spread(left, control, right):
        return np.moveaxis(left @ np.moveaxis(control, -1, 0) @ right.T, 0, -1)

    def residual(flat):
        control = flat.reshape(shape)
        found = surface.derivatives(spread(by, control, bx))[..., 1:3, :]
        ways = spread(by, control, dx), spread(dy, control, bx)
        rx, ry = (np.einsum("...k,...kd->...d", way, found) for way in ways)
        parts = [0.5 * (np.sum(rx * rx, -1) - 1), 0.5 * (np.sum(ry * ry, -1) - 1), np.sqrt(0.5) * np.sum(rx * ry, -1)]
        strain = np.stack(parts).reshape(-1)
        scale = _PIN * np.sqrt(strain.size)
        off = surface.derivatives(share @ control[0])[0] - end
        corner = surface.derivatives(control[0, 0])[0] - at[0]
        return np.concatenate([strain, scale * corner, [scale * (off @ side)]])

    near = kron(kron(csr_array(by != 0), csr_array(bx != 0)), np.ones((1, 2)))
    pins = np.zeros((4, guess.size))
    pins[:3, :2] = 1.0
    pins[3, : 2 * shape[1]] = np.repeat(share != 0, 2)
    pattern = vstack([near, near, near, csr_array(pins)])
    limits = {"ftol": 1e-9, "xtol": 1e-11, "gtol": 1e-14, "max_nfev": 100}
    best = least_squares(residual, guess.reshape(-1), jac_sparsity=pattern, x_scale="jac", **limits)
    strain = best.fun[:-4]
    return float(np.sqrt(0.5 * np.sum(strain**2) / (strain.size / 3)))


def _knots(length: float, spans: int, degree: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Of all basis functions together, as scipy's BSpline takes them."""
    breaks = np.linspace(0.0, length, spans + 1)
    knots = np.r_[np.full(degree, 0.0), breaks, np.full(degree, length)]
    return knots, np.eye(spans + degree), degree


def _bases(length: float, spans: int, degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values and slopes at Gauss points, and where linear functions have their coefficients."""
    knots, eye, _ = _knots(length, spans, degree)
    gauss = ((np.arange(spans)[:, None] + 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)) * (length / spans)).reshape(-1)
    spline = BSpline(knots, eye, degree)
    places = np.lib.stride_tricks.sliding_window_view(knots[1:-1], degree).mean(axis=1)
    return spline(gauss), spline(gauss, nu=1), places


def _geodesic(surface, start, along, length):
    """The end of a geodesic, and the direction across it there."""
    from scipy.integrate import solve_ivp

    def slope(_, state):
        r = surface.derivatives(state[:2])
        bend = state[2] ** 2 * r[3] + 2 * state[2] * state[3] * r[4] + state[3] ** 2 * r[5]
        return np.r_[state[2:], -np.linalg.lstsq(r[1:3].T, bend, rcond=None)[0]]

    end = solve_ivp(slope, (0.0, length), np.r_[start, along], rtol=1e-9, atol=1e-12).y[:, -1]
    r = surface.derivatives(end[:2])
    side = np.cross(np.cross(r[1], r[2]), end[2:] @ r[1:3])
    return end[:2], side / np.linalg.norm(side)
