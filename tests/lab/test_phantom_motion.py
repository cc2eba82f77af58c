"""The phantom's motions: velocities are the derivatives of places, and the stated sizes."""

import numpy as np
import pytest

from palpate.errors import InputError
from palpate_lab.simulation.phantom.motion import MOTIONS, Breathing, Sine, Step, SurfaceMotion, motion, unplanned

ALL = [motion(name, seed=3) for name in MOTIONS] + [
    SurfaceMotion(Breathing(0.01), Sine(0.1, 3.0), Sine(-0.15, 2.0)),
    SurfaceMotion(in_plane=Step(0.17, 0.5), out_of_plane=Step(-0.1, 0.55)),
    SurfaceMotion(in_plane=Sine(0.1, 3.0), out_of_plane=Sine(-0.15, 2.0), spin=Sine(0.3, 2.5)),
]


@pytest.mark.parametrize("moving", ALL)
def test_velocities_are_derivatives(moving: SurfaceMotion) -> None:
    """Central differences over 2e-6 s: rounding 1e-10, the third derivative (a step's, 4e3 rad/s^3) 1e-8."""
    half = 1e-6
    for time in np.concatenate([np.linspace(0.1, 1.9, 4), np.linspace(2.003, 14.98, 60), np.linspace(2.49, 2.66, 20)]):
        before, now, after = (moving.offset(float(time + shift)) for shift in (-half, 0.0, half))
        np.testing.assert_allclose((after[3] - before[3]) / (2 * half), now[4], atol=1e-7)
        spin = (after[:3] - before[:3]) / (2 * half) @ now[:3].T
        np.testing.assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], now[5], atol=1e-7)
        np.testing.assert_allclose(now[:3] @ now[:3].T, np.eye(3), atol=1e-12)


def test_sines_begin_with_their_velocity() -> None:
    """Equation (11): 10 mm or 10 deg times sin(2 pi t / T)."""
    moving = motion("in-plane", period=5.0, begin=1.0)
    assert not moving.offset(0.999)[4:].any()
    np.testing.assert_allclose(moving.offset(1.0)[5], [0.0, np.radians(10.0) * 2 * np.pi / 5.0, 0.0])
    np.testing.assert_allclose(moving.offset(2.25)[2, 0], -np.sin(np.radians(10.0)))
    np.testing.assert_allclose(motion("vertical").offset(4.5)[3], [0.0, 0.0, 0.010])
    assert motion("out-of-plane").offset(4.5)[2, 1] == pytest.approx(np.sin(np.radians(10.0)))


def test_breath_goes_out_slowly() -> None:
    heights = np.array([Breathing(0.010)(t)[0] for t in np.linspace(0.0, 4.0, 401)])
    assert heights.max() == pytest.approx(0.010)
    assert heights.min() == 0.0
    assert np.linspace(0.0, 4.0, 401)[heights.argmax()] == pytest.approx(1.6)


def test_unplanned_motion_keeps_its_bounds() -> None:
    times = np.linspace(2.0, 42.0, 801)
    for seed in range(4):
        angles = np.array([unplanned(seed).in_plane(t)[0] for t in times])
        assert np.radians(3.0) < np.abs(angles).max() <= np.radians(8.0)
    stepped, plain = unplanned(2, step_at=5.0), unplanned(2)
    assert stepped.in_plane(6.0)[0] - plain.in_plane(6.0)[0] == pytest.approx(np.radians(10.0))


def test_what_is_no_motion_is_refused() -> None:
    with pytest.raises(InputError, match="the motion 'sideways' is unknown"):
        motion("sideways")
    with pytest.raises(InputError, match="positive number of seconds"):
        motion("vertical", period=0.0)
    with pytest.raises(InputError, match="the direction"):
        unplanned(1, direction="up")
