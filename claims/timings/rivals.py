"""Other ways to the same facet contacts: NumPy over all facets at once, the paper's systems, embree at zero pitch."""

from collections.abc import Callable
from typing import Any

import numpy as np

import palpate
from palpate_lab.peers.facet_planes import INSIDE, facet_planes, paper_systems, system_filler

Query = Callable[[np.ndarray], np.ndarray]  # a wrench (6,) to the facets (k,) that it can touch


def reciprocal_products(mesh: palpate.Mesh) -> Query:
    """The fastest NumPy form known here: three six-vector products a facet, one matrix-vector product in all.

    With c = f . N and b a barycentric coordinate g . p + e, putting the closed form for p into c b leaves the moment of
    the wrench about the facet's edge: c b = f . (e N - d g) - M/|F| . (N x g). So a wrench touches a facet if its
    moments about the three edges have one sign, at any pitch.
    """
    normal, offset, slopes, rests = facet_planes(mesh)
    slopes = np.concatenate([slopes, -slopes.sum(axis=0, keepdims=True)])
    rests = np.concatenate([rests, 1.0 - rests.sum(axis=0, keepdims=True)])
    lines = np.concatenate(
        [rests[..., None] * normal - offset[:, None] * slopes, -np.cross(normal, slopes)], axis=2
    )  # (3, f, 6)
    edges = np.ascontiguousarray(lines.transpose(2, 0, 1).reshape(6, -1))
    moments, count = np.empty(edges.shape[1]), len(normal)

    def query(wrench: np.ndarray) -> np.ndarray:
        np.dot(wrench, edges, out=moments)
        return np.flatnonzero(
            np.maximum(np.maximum(moments[:count], moments[count : 2 * count]), moments[2 * count :]) <= 0
        )

    return query


def closed_form(mesh: palpate.Mesh) -> Query:
    """k, p0 and lambda for every facet, then two barycentric coordinates, as the derivation writes them."""
    normal, offset, slopes, rests = facet_planes(mesh)

    def query(wrench: np.ndarray) -> np.ndarray:
        force, moment = wrench[:3], wrench[3:]
        pressing = normal @ force
        k = -(force @ moment) / pressing
        origin = np.cross(force, moment + k[:, None] * normal) / (force @ force)
        reach = (-offset - np.einsum("fk,fk->f", normal, origin)) / pressing
        point = origin + reach[:, None] * force
        first, second = np.einsum("ifk,fk->if", slopes, point) + rests
        return np.flatnonzero((pressing < 0) & (first >= INSIDE) & (second >= INSIDE) & (first + second <= 1 - INSIDE))

    return query


def loop_of_solves(mesh: palpate.Mesh) -> Query:
    """The paper, literally: one system after another, all facets."""
    fill, normal, (_, _, slopes, rests) = system_filler(mesh), mesh.normals, facet_planes(mesh)

    def query(wrench: np.ndarray) -> np.ndarray:
        matrices, rights = fill(wrench)
        valid = []
        for i in range(len(normal)):
            point = np.linalg.solve(matrices[i], rights[i])[:3]
            if normal[i] @ wrench[:3] >= 0:
                continue
            first, second = slopes[0, i] @ point + rests[0, i], slopes[1, i] @ point + rests[1, i]
            if first >= INSIDE and second >= INSIDE and first + second <= 1 - INSIDE:
                valid.append(i)
        return np.array(valid, dtype=np.int64)

    return query


def batched_solve(mesh: palpate.Mesh) -> Query:
    solve = paper_systems(mesh)
    return lambda wrench: solve(wrench)[0]


def embree_scene(mesh: palpate.Mesh, **asked: object) -> Callable[[np.ndarray, np.ndarray], Any] | None:
    """What rays hit (origins and directions in millimetres, float32), raw embreex; None where not installed."""
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError:
        return None
    scene = EmbreeScene()
    keep = TriangleMesh(scene, np.ascontiguousarray(mesh.vertices * 1e3, np.float32), mesh.faces.astype(np.int32))

    def cast(origins: np.ndarray, directions: np.ndarray, _held: object = keep) -> Any:
        return scene.run(origins, directions, **asked)

    return cast
