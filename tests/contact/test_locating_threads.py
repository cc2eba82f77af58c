"""A log located by several threads is the log located sample by sample, to the last bit."""

import numpy as np
import pytest
import trimesh

from palpate.contact import locating_threads
from palpate.contact.estimate import ROW, Status
from palpate.contact.locate import Locator
from palpate.contact.locating_threads import LocatingThreads, Pending
from palpate.signals.recording import Recording
from palpate.surfaces import Mesh

SIGMA = np.array([0.02] * 3 + [5e-4] * 3)


@pytest.fixture(scope="module")
def locator() -> Locator:
    """On a torus: most lines of action meet it several times, so that much goes from sample to sample."""
    made = trimesh.creation.torus(major_radius=0.04, minor_radius=0.015, major_sections=24, minor_sections=12)
    return Locator(Mesh.from_trimesh(made, unit="m"), noise=SIGMA)


def wrenches(locator: Locator, lengths: tuple[int, ...], rest: int) -> np.ndarray:
    """Touches of so many samples that swell, slide and fade below what begins a contact, with rests between them."""
    rng = np.random.default_rng(len(lengths))
    found: list[np.ndarray] = []
    for length in lengths:
        phase = np.linspace(0, 1, length)[:, None]
        angle = rng.uniform(0, 2 * np.pi) + 0.2 * phase
        out = np.concatenate([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
        normal = np.cos(0.7) * out + np.sin(0.7) * np.array([0.0, 0.0, 1.0])
        force = -(0.085 + 2 * np.maximum(np.sin(1.2 * np.pi * phase), 0.0)) * normal
        touch = np.concatenate([force, np.cross(0.04 * out + 0.015 * normal, force)], axis=1)
        found += [touch, np.zeros((rest, 6))]
    whole = np.concatenate(found)
    whole += SIGMA * rng.normal(size=whole.shape)
    whole[7::97, 2] = np.nan
    return whole


@pytest.mark.parametrize("known", [True, False], ids=["noise of the locator", "covariances"])
@pytest.mark.parametrize("piece", [1, 40, 333])
def test_threads_give_the_same_bits(locator: Locator, piece: int, known: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Touches shorter than a piece and longer than several, pieces without a rest, some asked for before the next."""
    monkeypatch.setattr(locating_threads, "LONG", 100)
    given = wrenches(locator, (30, 300, 25, 900, 60, 60), rest=20)
    statuses, expected, rows = np.full(len(given), -1, np.int8), locator.empty(len(given)), list[np.ndarray]()
    statuses[50::111] = Status.NO_POSE
    covariances = None if known else np.broadcast_to(np.diag(SIGMA**2), (len(given), 6, 6)).copy()
    locator.reset()
    locator.run_into(given, covariances, statuses, expected)
    assert {Status.CONTACT, Status.NO_CONTACT, Status.AMBIGUOUS} <= set(expected[:, ROW.status].astype(int))

    def part(span: slice) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
        return given[span], None if covariances is None else covariances[span], statuses[span]

    locator.reset()
    rest = slice(len(given) - 25, None)  # from where the last touch has faded: by the Locator alone
    spans = [slice(start, min(start + piece, rest.start)) for start in range(0, rest.start, piece)]
    with LocatingThreads(locator, 3) as threads:
        pending = list[Pending]()
        for number, span in enumerate(spans):
            pending.append(threads.put(Recording(np.zeros(len(given[span])), {}), *part(span)))
            if number % 5 == 4:
                rows += [each.result().rows for each in pending]
                pending = []
        threads.finish()
        rows += [each.result().rows for each in pending]
    rows.append(locator.empty(25))
    locator.run_into(*part(rest), rows[-1])
    assert np.array_equal(np.concatenate(rows), expected, equal_nan=True)


def test_a_sample_is_free_whatever_came_before(locator: Locator) -> None:
    """Below the force where a contact ends, not below the one where it begins; a bad sample says nothing."""
    force = np.zeros((6, 6))
    force[:, 2] = SIGMA[2] * np.array([9.0, 4.0, np.nan, 9.0, 2.0, 0.0])
    statuses = np.full(6, -1, np.int8)
    assert locator.first_free(force, None, statuses) == 4
    statuses[4] = Status.INVALID
    assert locator.first_free(force, None, statuses) == 5
    assert locator.first_free(force[:4], None, statuses[:4]) == -1
