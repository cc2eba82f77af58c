"""What is usual: a wrench shared between known places without a word about friction.

`minimum_norm` is the least-squares answer of least length. `iDynTree` is the library itself: a link on a sensor, pure
forces at known points, `estimateExtWrenchesAndJointTorques`. Where forces are not determined its answer has components
that are exactly zero, as a pivoted QR leaves them: it is not the minimum norm.
"""

from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

_LINK = (
    '<link name="{}"><inertial><mass value="1"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
)
_ROBOT = (
    '<robot name="r">'
    + _LINK.format("base")
    + _LINK.format("arm")
    + '<joint name="ft" type="fixed"><parent link="base"/><child link="arm"/></joint>'
    '<sensor name="ft" type="force_torque"><parent joint="ft"/><force_torque><frame>child</frame>'
    "<measure_direction>child_to_parent</measure_direction></force_torque></sensor></robot>"
)


class IDynTree:
    """The library, with a link that weighs nothing (no gravity, at rest) on a six-axis sensor at the origin."""

    def __init__(self) -> None:
        self._api: Any = import_module("idyntree.bindings")
        api = self._api
        loader = api.ModelLoader()
        with TemporaryDirectory() as folder:
            file = Path(folder) / "robot.urdf"
            file.write_text(_ROBOT, encoding="utf-8")
            loader.loadModelFromFile(str(file))
        self._model = loader.model().copy()
        self._estimator = api.ExtWrenchesAndJointTorquesEstimator()
        self._estimator.setModel(self._model)
        still = [api.JointPosDoubleArray(self._model), *(api.JointDOFsDoubleArray(self._model) for _ in range(2))]
        weightless = api.Vector3()
        weightless.zero()
        self._estimator.updateKinematicsFromFixedBase(*still, self._model.getFrameIndex("base"), weightless)

    def forces(self, points: np.ndarray, wrench: np.ndarray) -> np.ndarray:
        """(n, 3) [N] pure forces at points (n, 3) [m] that make a wrench (6,)."""
        api, model = self._api, self._model
        unknown, arm = api.LinkUnknownWrenchContacts(model), model.getLinkIndex("arm")
        unknown.addNewUnknownFullWrenchInFrameOrigin(model, model.getFrameIndex("base"))
        for point in points:
            contact = api.UnknownWrenchContact(api.PURE_FORCE, api.Position(*(float(each) for each in point)))
            unknown.addNewContactForLink(arm, contact)
        read, value = api.SensorsMeasurements(model.sensors()), api.Wrench()
        for axis in range(6):
            value.setVal(axis, float(wrench[axis]))
        read.setMeasurement(api.SIX_AXIS_FORCE_TORQUE, 0, value)
        found, torques = api.LinkContactWrenches(model), api.JointDOFsDoubleArray(model)
        if not self._estimator.estimateExtWrenchesAndJointTorques(unknown, read, found, torques):
            raise RuntimeError("iDynTree found no forces")
        each = [found.contactWrench(arm, i).contactWrench for i in range(len(points))]
        return np.array([[wrench.getVal(axis) for axis in range(3)] for wrench in each])
