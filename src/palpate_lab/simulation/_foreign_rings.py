"""Compiled: press bodies against a ring that is known by its compliance, with unilateral contact and Coulomb friction.

Nodes are at outer radius R, moved by u = C f outwards and along. With the gap g to its body, pressure p, friction t:

    p >= 0,  g + k p >= 0,  p (g + k p) = 0,  |t| <= mu p,  no slip where |t| < mu p,

by Gauss-Seidel over the nodes, stage by stage of the bodies' ways [Jean 1999].
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry, inner

_TURNS, _SWEEPS, _EXACT = 40, 400, 1e-7  # normals anew, sweeps with them, N


@inner
def _gap(angle, body, stage, moved, outer):
    """Return a node's gap to its body, and the body's normal outwards and along the ring at the node."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = (outer + moved[0]) * c - moved[1] * s, (outer + moved[0]) * s + moved[1] * c
    way, depth, radius, slide = body[0], body[1] * stage[0], body[2], body[3] * stage[1]
    e, f = np.cos(way), np.sin(way)
    if np.isinf(radius):
        gap, p, q = outer - depth - x * e - y * f, -e, -f
    else:
        x -= (outer + radius - depth) * e - slide * f
        y -= (outer + radius - depth) * f + slide * e
        far = np.sqrt(x * x + y * y)
        gap, p, q = far - radius, x / far, y / far
    return gap, p * c + q * s, q * c - p * s


@inner
def _sweep(compliance, angles, bodies, stage, carried, law, normal, loads, moved):
    """Correct each node's pressure and friction once; return the largest change [N]."""
    friction, local, outer = law[0], law[1], law[2]
    worst = 0.0
    for i in range(len(angles)):
        a, b = normal[i, 0], normal[i, 1]
        gap, _, _ = _gap(angles[i], bodies[i], stage, moved[i], outer)
        out, mixed, along = (
            compliance[2 * i, 2 * i],
            compliance[2 * i, 2 * i + 1],
            compliance[2 * i + 1, 2 * i + 1],
        )
        gives = a * a * out + 2.0 * a * b * mixed + b * b * along + local
        yields = b * b * out - 2.0 * a * b * mixed + a * a * along + 2.0 * local
        slip = (moved[i, 0] - carried[i, 0]) * b - (moved[i, 1] - carried[i, 1]) * a
        pressure = max(0.0, loads[i, 0] - (gap + local * loads[i, 0]) / gives)
        most = friction * pressure
        pull = min(max(loads[i, 1] - slip / yields, -most), most)
        dp, dt = pressure - loads[i, 0], pull - loads[i, 1]
        if dp != 0.0 or dt != 0.0:
            loads[i, 0], loads[i, 1] = pressure, pull
            x, y = dp * a + dt * b, dp * b - dt * a
            for j in range(len(angles)):
                moved[j, 0] += compliance[2 * i, 2 * j] * x + compliance[2 * i + 1, 2 * j] * y
                moved[j, 1] += compliance[2 * i, 2 * j + 1] * x + compliance[2 * i + 1, 2 * j + 1] * y
            worst = max(worst, abs(dp), abs(dt))
    return worst


@entry("compliance a a, angles n, bodies n 4, stages s 2, law 3, normal out n 2, loads out n 2, moved out n 2")
def press(compliance, angles, bodies, stages, law, normal, loads, moved):
    """Move bodies through their stages; write what they do to each node.

    Args:
        compliance: (2 n, 2 n), symmetric [m/N].
        angles: (n,) of the nodes [rad].
        bodies: (n, 4) angle [rad], depth, radius and slide [m] of the body that each node may touch.
        stages: (s, 2) shares of depth and of slide.
        law: (3,) coefficient of friction, the nodes' own compliance [m/N], outer radius [m].
        normal: (n, 2) of the body at each node, outwards and along.
        loads: (n, 2) pressure and friction on each node [N].
        moved: (n, 2) of the nodes, outwards and along [m].
    """
    count, before = len(angles), np.zeros(2)
    carried, force = np.empty((count, 2)), np.empty(2 * count)
    loads[:] = 0.0
    moved[:] = 0.0
    for stage in stages:
        for i in range(count):  # where a node is that sticks to its body
            turn = bodies[i, 0] - angles[i]
            out, along = -bodies[i, 1] * (stage[0] - before[0]), bodies[i, 3] * (stage[1] - before[1])
            carried[i, 0] = moved[i, 0] + out * np.cos(turn) - along * np.sin(turn)
            carried[i, 1] = moved[i, 1] + out * np.sin(turn) + along * np.cos(turn)
        before = stage
        for _ in range(_TURNS):
            for i in range(count):
                _, a, b = _gap(angles[i], bodies[i], stage, moved[i], law[2])
                normal[i, 0], normal[i, 1] = a, b
                force[2 * i], force[2 * i + 1] = loads[i, 0] * a + loads[i, 1] * b, loads[i, 0] * b - loads[i, 1] * a
            for i in range(count):
                moved[i, 0] = np.sum(compliance[2 * i] * force)
                moved[i, 1] = np.sum(compliance[2 * i + 1] * force)
            sweeps = 0
            while sweeps < _SWEEPS:
                sweeps += 1
                if _sweep(compliance, angles, bodies, stage, carried, law, normal, loads, moved) < _EXACT:
                    break
            if sweeps == 1:
                break
