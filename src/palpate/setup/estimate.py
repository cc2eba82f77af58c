"""Estimate every contact in a log with a rig, as `palpate estimate` does."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path

from palpate.calls import called_as
from palpate.contact.contacts import Contacts
from palpate.errors import InputError
from palpate.setup.load import load_rig, robot_of
from palpate.setup.pipeline import LogLike, Pipeline, open_log
from palpate.setup.rig import ESTIMATE, Rig, with_mesh
from palpate.setup.robot import Robot
from palpate.setup.robot_pipeline import RobotPipeline
from palpate.waiting import waiting


@called_as(
    ESTIMATE,
    rate='palpate.estimate({"time": np.arange(len(wrenches)) / rate, "force": wrenches[:, :3], '
    '"torque": wrenches[:, 3:]}, "rig.toml")',
    start='contacts = palpate.estimate("log.csv", "rig.toml"), then contacts[contacts.time >= start]',
    end='contacts = palpate.estimate("log.csv", "rig.toml"), then contacts[contacts.time < end]',
    surface="palpate.WrenchEstimator(surface, palpate.ForceTorque(noise=(0.02, 0.001))).run("
    'palpate.Recording(time, {"force": force, "torque": torque})), or a rig with [surface] kind = "ellipsoid"',
    payload='a rig with [force_torque] payload = "payload.toml", then palpate.estimate("log.csv", "rig.toml")',
    output='palpate.estimate("log.csv", "rig.toml").save("contacts.csv")',
)
def estimate(
    log: LogLike,
    rig: Rig | Robot | str | PathLike[str] | None = None,
    *,
    mesh: str | PathLike[str] | None = None,
    unit: str | None = None,
    frame: str = "surface",
    sensor: str | None = None,
    topic: str | None = None,
) -> Contacts:
    """Estimate every contact in a log, exactly as `palpate estimate` does.

    Args:
        log: the file, or a bag's folder; or a table of polars or pandas, or arrays by their names, as a file has them.
        rig: the rig, or its file, of a sensor or of a robot. None: the mesh is in the frame of a tared six-axis sensor.
        mesh: file of the surface, in place of the rig's.
        unit: unit of the mesh file's numbers: m, cm, mm, um or in.
        frame: frame of the contacts: "surface", "sensor" or "base".
        sensor: name of the sensor's table in the rig, if the log fits several sensors, or of a robot's sensor alone.
        topic: topic of the sensor's readings, in place of the one that the rig names.

    Returns:
        The contacts, at least one row for each sample; `notes` has warnings, then notes. Those of a robot's sensors are
        in the order of their times, with `sensor` and `link` of each row.

    Raises:
        InputError: the log, the mesh or a file of the rig cannot be used, there is neither a rig nor a mesh, the unit
            or frame is unknown, or the log has no poses for the base or does not begin at rest although it must.
        GeometryError: the mesh has no usable surface.
        NotIdentifiable: the load cells that the rig uses do not determine a wrench.
    """
    known = rig if isinstance(rig, Rig | Robot) or rig is None else robot_of(rig) or load_rig(rig)
    if isinstance(known, Robot):
        return _of_robot(log, known, frame, sensor, {"mesh": mesh, "unit": unit, "topic": topic})
    known = known if mesh is None else with_mesh(known, mesh, unit)
    if known is None:
        raise InputError("neither a rig nor a mesh is given.", hint=f"Write {ESTIMATE}.")
    if mesh is None and unit is not None:
        raise InputError("unit belongs to a mesh, and no mesh is given.", hint='Write mesh="probe.stl", unit="mm".')
    name = log if isinstance(log, str | PathLike) else "the log"
    with waiting(f"finding the contacts in {name}"), open_log(log, known, sensor, topic) as opened:
        pipeline = Pipeline.of(opened, frame)
        found = Contacts.joined([contacts for _, _, contacts in pipeline.stream()])
        first = [said for said in (opened.torn, pipeline.unbelievable()) if said]
        return found.noted((*first, *pipeline.warnings(), *pipeline.notes()))


def _of_robot(log: LogLike, robot: Robot, frame: str, sensor: str | None, refused: Mapping[str, object]) -> Contacts:
    """Estimate the contacts of a robot's sensors."""
    for name, value in refused.items():
        if value is not None:
            hint = "Write it in the rig's [sensors.NAME]."
            raise InputError(f"{name} is of one sensor, and the rig is of a robot.", where=str(robot.path), hint=hint)
    if not isinstance(log, str | PathLike):
        raise InputError("the log of a robot must be a file.", where=str(robot.path), hint="Write its path.")
    with waiting(f"finding the contacts in {log}"):
        pipeline = RobotPipeline(robot, Path(log), frame, sensor)
        found = Contacts.joined(list(pipeline.stream()))
        return found.noted((*pipeline.warnings(), *pipeline.notes()))
