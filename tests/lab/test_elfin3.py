"""The arm's table against the maker's own description, and its two descriptions against each other."""

import re
from pathlib import Path

import numpy as np
import pytest

from palpate_lab.simulation.phantom.elfin3 import JOINTS, LINKS, SENSOR, mjcf, urdf
from palpate_lab.simulation.phantom.probes import probe

pin = pytest.importorskip("pinocchio")
mujoco = pytest.importorskip("mujoco")

PROBE = probe("linear")


def _placed(model, frame: str, joints: np.ndarray) -> np.ndarray:
    data = model.createData()
    pin.framesForwardKinematics(model, data, joints)
    return data.oMf[model.getFrameId(frame)].homogeneous


def _postures() -> np.ndarray:
    return np.random.default_rng(1).uniform(-2.3, 2.3, (20, 6))


def test_the_arm_moves_as_its_maker_describes_it(shared: Path) -> None:
    """To 1e-9: the same figures, so only rounding differs."""
    text = (shared / "data/elfin3/elfin3.urdf.xacro").read_text()
    text = re.sub(r"<xacro:[^>]*/>", "", text).replace("${PI/2}", repr(np.pi / 2)).replace("${-PI/2}", repr(-np.pi / 2))
    theirs = pin.buildModelFromXML(text.replace('xmlns:xacro="http://www.ros.org/wiki/xacro"', ""))
    ours = pin.buildModelFromXML(urdf(PROBE))
    for joints in _postures():
        expected = _placed(theirs, "elfin_end_link", joints)
        np.testing.assert_allclose(_placed(ours, SENSOR, joints), expected, atol=1e-9)
    np.testing.assert_allclose(ours.upperPositionLimit, theirs.upperPositionLimit)
    np.testing.assert_allclose(ours.effortLimit, theirs.effortLimit)
    arm = theirs.inertias[1:]
    for link, inertia in zip(LINKS[:-1], list(arm)[:-1], strict=True):  # the last one of ours carries the probe
        np.testing.assert_allclose([inertia.mass, *inertia.lever], [link.mass, *link.centre], atol=1e-12)


def test_both_descriptions_are_one_robot() -> None:
    """Places to 1e-9, and the mass matrix: every mass, centre and inertia is in it."""
    ours = pin.buildModelFromXML(urdf(PROBE))
    data = ours.createData()
    text = mjcf(PROBE, timestep=0.001, accelerometer=(0.0, 0.0, 0.0), phantom=(0.1, 0.1, 0.03))
    engine = mujoco.MjModel.from_xml_string(text)
    state, mass = mujoco.MjData(engine), np.zeros((6, 6))
    assert [engine.joint(i).name for i in range(6)] == list(JOINTS) == list(ours.names)[1:]
    for joints in _postures():
        state.qpos[:] = joints
        mujoco.mj_forward(engine, state)
        seen = _placed(ours, SENSOR, joints)
        np.testing.assert_allclose(state.site(SENSOR).xpos, seen[:3, 3], atol=1e-9)
        np.testing.assert_allclose(state.site(SENSOR).xmat.reshape(3, 3), seen[:3, :3], atol=1e-9)
        for column in range(6):
            mujoco.mj_mulM(engine, state, mass[column], np.eye(6)[column])
        upper = np.triu(pin.crba(ours, data, joints))
        np.testing.assert_allclose(np.triu(mass), upper, atol=1e-9)
