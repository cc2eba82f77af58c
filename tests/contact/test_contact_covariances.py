"""Covariances of what is done with a contact's place: its ellipse, its frame, and a changed wrench."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.contact._widen import widen
from palpate.contact.drift_gate import ContactShape
from palpate.contact.ellipse import ellipse
from palpate.contact.estimate import CHI2_95, ROW, ContactEstimate, Status
from palpate.contact.events import largest_deviation
from palpate.contact.frames import in_base
from palpate.contact.locate import Locator
from palpate.signals.wrench_sensor import Placement
from palpate.surfaces import Sphere
from tests.support.dice import agree, joint, mixed, rolled
from tests.support.payloads import MOUNT, MOUNTED, READING, in_surface

NORMALS = np.concatenate([np.eye(3), -np.eye(3), Rotation.random(9, random_state=1).as_matrix()[:, 0]])
SPREADS = np.stack([mixed(np.array([1e-3, 4e-3, 2e-3]), k) for k in range(len(NORMALS))])


def flat(normals: np.ndarray, spreads: np.ndarray) -> np.ndarray:
    """Covariances across unit normals."""
    across = np.eye(3) - normals[:, :, None] * normals[:, None, :]
    return across @ spreads @ across


def test_an_ellipse_has_the_covariance_in_its_plane_whichever_way_that_lies() -> None:
    axes, frames = ellipse(SPREADS, NORMALS)
    sizes = np.concatenate([axes**2 / CHI2_95, np.zeros((len(axes), 1))], axis=1)
    np.testing.assert_allclose(
        (frames * sizes[:, None]) @ frames.swapaxes(1, 2), flat(NORMALS, SPREADS), atol=1e-12 * SPREADS.max()
    )
    np.testing.assert_allclose(frames @ frames.swapaxes(1, 2), np.tile(np.eye(3), (len(axes), 1, 1)), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)
    assert (axes[:, 0] > axes[:, 1]).all()
    one, frame = ellipse(SPREADS[7], NORMALS[7])
    np.testing.assert_array_equal(one, axes[7])
    np.testing.assert_array_equal(frame, frames[7])
    values = np.linalg.eigvalsh(SPREADS)[:, -1]
    np.testing.assert_allclose(largest_deviation(SPREADS) ** 2, values, rtol=1e-9)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_an_estimate_in_the_base_is_turned_as_its_sensor_and_its_surface(count: int) -> None:
    rows = np.zeros((count, 22))
    rows[:, ROW.point], rows[:, ROW.normal] = 0.01 * NORMALS[6 : 6 + count], NORMALS[6 : 6 + count]
    rows[:, ROW.covariance] = SPREADS[:count].reshape(-1, 9)
    found = ContactEstimate.from_rows(rows)
    turns, places = Rotation.random(count, random_state=2) if count else None, np.arange(3.0 * count).reshape(count, 3)
    quaternions = np.zeros((0, 4)) if turns is None else turns.as_quat()
    moved = in_base(found, quaternions, places, MOUNT)
    assert moved.covariance.shape == (count, 3, 3)
    for k in range(count):

        def there(off: np.ndarray, k: int = k) -> np.ndarray:
            assert turns is not None
            return turns[k].apply(MOUNT.apply(found.point[k] + off)) + places[k]

        np.testing.assert_allclose(moved.point[k], there(np.zeros(3)), atol=1e-14)
        agree(moved.covariance[k], rolled(there, SPREADS[k]))


@pytest.mark.parametrize("count", [0, 1, 15])
def test_a_place_that_is_off_along_the_surface_is_as_unsure_in_both_its_ways(count: int) -> None:
    rows = np.full((count, 22), np.nan)
    rows[:, ROW.normal], rows[:, ROW.covariance] = NORMALS[:count], SPREADS[:count].reshape(-1, 9)
    widen(rows, 4e-6)
    expected = SPREADS[:count] + 4e-6 * flat(NORMALS[:count], np.tile(np.eye(3), (count, 1, 1)))
    np.testing.assert_allclose(rows[:, ROW.covariance].reshape(-1, 3, 3), expected, rtol=1e-12, atol=1e-18)


def test_a_change_of_the_zero_is_judged_with_the_errors_of_the_mounting() -> None:
    """And with moments that are off by a share of the force, whichever way."""
    shape, own, given = ContactShape(Locator(Sphere(0.02)), Placement(MOUNT, MOUNTED)), mixed(np.full(6, 0.1), 6), []

    def run(wrenches: np.ndarray, spreads: np.ndarray, *, sequential: bool) -> SimpleNamespace:
        given.append((wrenches[0], spreads[0]))
        return SimpleNamespace(status=np.array([Status.CONTACT]), residual=np.array([0.0]))

    slack, shape._locator = shape._slack, SimpleNamespace(run=run)
    assert shape.explains(READING, own)
    [(wrench, spread)] = given
    np.testing.assert_allclose(wrench, in_surface(READING), atol=1e-12)
    arm = slack**2 * (READING[:3] @ READING[:3]) * np.eye(3)
    parts = rolled(lambda off: in_surface(READING + off[:6], off[6:]), joint(own, MOUNTED))
    parts[3:, 3:] += arm
    agree(spread, parts)
