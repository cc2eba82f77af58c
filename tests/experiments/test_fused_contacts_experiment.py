"""Fusion's experiment: its truth is consistent, others' ways explain the wrench, and ours is nearer to the truth."""

import numpy as np
import pytest

from claims.papers.fused_contacts.bench import APART, Conditions, box, forearm, touch
from claims.papers.fused_contacts.study import Sizes, forces
from claims.papers.fused_contacts.theirs import IDynTree
from palpate_lab.peers.skin_peers import minimum_norm

EXACT = Conditions(gain=0.0, place=0.0, noise=(0.0, 0.0))


@pytest.mark.parametrize("make", [forearm, box])
def test_a_touch_is_within_friction_and_on_the_body(make) -> None:
    rng = np.random.default_rng(1)
    body = make(rng)
    made = touch(body, 4, rng, EXACT)
    on, normals, _ = body.mesh().project(made.places)
    assert np.linalg.norm(on - made.places, axis=1).max() < 2e-4  # 48 chords of a circle of 40 mm: 0.09 mm
    assert np.einsum("ni,ni->n", normals, made.normals).min() > 0.99
    pressing = -np.einsum("ni,ni->n", made.forces, made.normals)
    across = np.linalg.norm(made.forces + pressing[:, None] * made.normals, axis=1)
    assert (across <= 0.5 * pressing + 1e-12).all()
    apart = np.linalg.norm(made.places[:, None] - made.places[None], axis=2) + np.eye(4)
    assert apart.min() >= APART
    np.testing.assert_allclose(made.felt, pressing)


def test_others_explain_the_wrench() -> None:
    pytest.importorskip("idyntree")
    rng = np.random.default_rng(2)
    made = touch(forearm(rng), 3, rng, EXACT)
    for found in (minimum_norm(made.places, made.wrench), IDynTree().forces(made.places, made.wrench)):
        sums = np.concatenate([found.sum(axis=0), np.cross(made.places, found).sum(axis=0)])
        np.testing.assert_allclose(sums, made.wrench, atol=1e-8)


def test_forces_are_nearer_than_the_skins_and_the_shortest() -> None:
    found = forces("box", 2, Conditions(), Sizes(bodies=2, touches=10), 7, others=False)
    assert np.median(found.ours) < 0.6 * np.median(found.skin)  # measured: a quarter
    assert found.held > 0.8  # 40 forces
