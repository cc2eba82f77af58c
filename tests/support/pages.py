"""Small sessions to show, and what a test of the page needs to look at them."""

import numpy as np
from jaxtyping import Float

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ContactEstimate, Status
from palpate.surfaces.mesh import Mesh
from palpate_lab.simulation.shapes import EllipsoidBody

BODY = EllipsoidBody((0.03, 0.02, 0.015))
SPREAD = (4e-4, 2e-4)  # m: standard deviations along the two tangents of `tangents`


def ellipsoid(facets: int = 500) -> Mesh:
    """A body whose surface is known."""
    return Mesh.from_arrays(*BODY.mesh(facets))


def tangents(normal: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Two unit vectors across each normal and across each other."""
    along = np.cross(normal, [0.0, 0.0, 1.0])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return along, np.cross(normal, along)


def session(count: int = 400, rate: float = 100.0) -> Contacts:
    """A quarter free, half touched at x > 0 and moving, a quarter free."""
    time = 100.0 + np.arange(count) / rate
    share = np.linspace(0.0, 1.0, count)
    touched = (share >= 0.25) & (share < 0.75)
    turn = 0.3 + 2.0 * (share - 0.5)
    point = BODY.on_ray(np.stack([np.cos(turn), np.sin(turn), np.full(count, 0.4)], axis=1))
    normal = BODY.normals(point)
    along, across = tangents(normal)
    covariance = sum(
        (s**2 * np.einsum("ni,nj->nij", axis, axis) for s, axis in zip(SPREAD, (along, across), strict=True)),
        np.zeros((count, 3, 3)),
    )
    force = np.where(touched, 2.0 + 3.0 * share, 0.01)[:, None] * -normal
    missing = np.where(touched, 1.0, np.nan)
    estimate = ContactEstimate(
        point=point * missing[:, None],
        normal=normal * missing[:, None],
        force=force,
        torque=1e-3 * missing,
        covariance=covariance * missing[:, None, None],
        residual=np.zeros(count),
        candidates=touched.astype(np.int64),
        status=np.where(touched, Status.CONTACT, Status.NO_CONTACT).astype(np.int8),
    )
    return Contacts.single(time, estimate)


def one_a_second(touches: int, start: float = 0.0) -> Contacts:
    """Touches of 0.5 s, one a second, at 100 Hz: 3 N at (1, -2, 3) mm, which is known to 0.5 mm."""
    count = 100 * touches
    status = np.where(np.arange(count) % 100 < 50, Status.CONTACT, Status.NO_CONTACT).astype(np.int8)
    there = status == Status.CONTACT
    point = np.where(there[:, None], [0.001, -0.002, 0.003], np.nan)
    normal, force = (np.where(there[:, None], [0.0, 0.0, size], np.nan) for size in (1.0, -3.0))
    covariance = np.where(there[:, None, None], 0.25e-6 * np.diag([1.0, 1.0, 0.0]), np.nan)
    torque, ones = np.where(there, 0.0, np.nan), np.ones(count, dtype=np.int64)
    estimate = ContactEstimate(point, normal, np.nan_to_num(force), torque, covariance, np.zeros(count), ones, status)
    return Contacts.single(start + np.arange(count) / 100, estimate)


def two_contacts(count: int = 100, rate: float = 50.0) -> Contacts:
    """One contact at x > 0 all the time; a second at x < 0, twice as strong, in the middle half."""
    sample, identity = [], []
    for k in range(count):
        ones = (1, 2) if count // 4 <= k < 3 * count // 4 else (1,)
        sample += [k] * len(ones)
        identity += ones
    sample, identity = np.array(sample), np.array(identity)
    turn = 0.4 * (sample / count - 0.5) + np.pi * (identity == 2)
    point = BODY.on_ray(np.stack([np.cos(turn), np.sin(turn), np.full(len(turn), 0.4)], axis=1))
    normal = BODY.normals(point)
    along, across = tangents(normal)
    estimate = ContactEstimate(
        point=point,
        normal=normal,
        force=-identity[:, None] * normal,
        torque=np.full(len(turn), np.nan),
        covariance=SPREAD[0] ** 2 * (np.einsum("ni,nj->nij", along, along) + np.einsum("ni,nj->nij", across, across)),
        residual=np.zeros(len(turn)),
        candidates=np.ones(len(turn), dtype=np.int64),
        status=np.zeros(len(turn), dtype=np.int8),
    )
    return Contacts(sample, sample / rate, identity, estimate, {"area": 1e-4 * identity.astype(np.float64)})
