"""The first calls that one writes from memory: each works, or is answered with the line that does."""

import builtins
import importlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import trimesh
from polars.testing import assert_frame_equal

import palpate
from palpate.calls import called_as
from palpate.errors import InputError

WRENCH = [0.0, 0.0, -5.0, 0.02, 0.0, 0.0]  # pressed from above at (0, -4) mm, on a cube of 40 mm
wrong: Any = importlib.import_module("palpate.surfaces")  # for calls that a type checker refuses
COLUMNS = ("time", "fx", "fy", "fz", "tx", "ty", "tz", "qx", "qy", "qz", "qw", "x", "y", "z")
RIG = """
[surface]
mesh = "probe.stl"
unit = "mm"

[force_torque]
noise = { force = 0.02, torque = 0.001 }

[filter]
kind = "kalman"
"""


@dataclass(frozen=True)
class Bench:
    """A folder with probe.stl, log.csv and rig.toml, and what they were written from."""

    folder: Path
    box: trimesh.Trimesh
    mesh: palpate.Mesh
    log: pl.DataFrame

    @property
    def contacts(self) -> palpate.Contacts:
        """Two touches, of 0.5 and 1 s."""
        return palpate.estimate(self.folder / "log.csv", mesh=self.folder / "probe.stl", unit="mm")


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    folder = tmp_path_factory.mktemp("bench")
    box = trimesh.creation.box((40, 40, 40))
    box.export(folder / "probe.stl")
    (folder / "rig.toml").write_text(RIG)
    time = np.arange(300) / 100
    touched = ((time > 0.5) & (time < 1.0)) | ((time > 1.5) & (time < 2.5))
    noise = np.random.default_rng(3).normal(0.0, np.repeat([0.02, 1e-3], 3), (300, 6))
    wrenches = touched[:, None] * np.array(WRENCH) + noise
    poses = np.tile([0, 0, 0, 1, 0.1, 0.2, 0.3], (300, 1))
    log = pl.DataFrame(dict(zip(COLUMNS, np.column_stack([time, wrenches, poses]).T, strict=True)))
    log.write_csv(folder / "log.csv")
    return Bench(folder, box, palpate.Mesh.load(folder / "probe.stl", unit="mm"), log)


@pytest.fixture
def here(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Bench:
    """The same, where the program runs in its folder."""
    monkeypatch.chdir(bench.folder)
    return bench


def same(found: palpate.Contacts, due: palpate.Contacts) -> None:
    assert_frame_equal(found.to_polars(), due.to_polars())


def test_a_body_may_be_a_file_or_of_trimesh(here: Bench) -> None:
    due = palpate.locate(WRENCH, here.mesh, noise=(0.02, 0.001))
    np.testing.assert_allclose(due.point, [0, -4e-3, 20e-3], atol=1e-12)
    of_file = palpate.locate(WRENCH, "probe.stl", noise=(0.02, 0.001), unit="mm")
    loaded: Any = trimesh.load("probe.stl")
    of_trimesh = palpate.locate(WRENCH, loaded, noise=[0.02] * 3 + [0.001] * 3, unit="mm")
    scene: Any = trimesh.Scene([here.box])
    of_scene = palpate.Locator(scene, unit="mm", noise=(0.02, 0.001)).run(WRENCH)
    in_loop = palpate.Locator(Path("probe.stl"), unit="mm", noise=(0.02, 0.001)).run(WRENCH)
    for found in (of_file, of_trimesh, of_scene, in_loop):
        np.testing.assert_array_equal(found.point, due.point)
        np.testing.assert_array_equal(found.covariance, due.covariance)
    with pytest.raises(InputError, match='Write unit="mm"'):
        palpate.locate(WRENCH, loaded)
    with pytest.raises(InputError, match='Write unit="mm"'):
        palpate.locate(WRENCH, "probe.stl")
    with pytest.raises(InputError, match=r"in metres.*Leave"):
        palpate.locate(WRENCH, here.mesh, unit="mm")
    loaded.units = "millimeters"
    np.testing.assert_array_equal(palpate.locate(WRENCH, loaded).point, due.point)


def test_a_file_is_read_at_each_call(here: Bench, tmp_path: Path) -> None:
    path = tmp_path / "tip.stl"
    for side in (40, 60):
        trimesh.creation.box((side, side, side)).export(path)
        assert palpate.locate(WRENCH, path, unit="mm").point[2] == pytest.approx(1e-3 * side / 2)


@pytest.mark.parametrize("kind", ["polars", "pandas", "arrays", "named", "records"])
def test_a_log_may_be_in_memory(here: Bench, kind: str) -> None:
    held: dict[str, Any] = {
        "polars": here.log,
        "pandas": _Frame(here.log),
        "arrays": {name: here.log[name].to_numpy() for name in COLUMNS[:7]},
        "named": {
            "time": here.log["time"].to_list(),
            "force": here.log[["fx", "fy", "fz"]].to_numpy(),
            "torque": here.log[["tx", "ty", "tz"]].to_numpy(),
        },
        "records": here.log.with_columns((1e6 * pl.col("time")).round().cast(pl.Datetime("us")).alias("time")),
    }
    found = palpate.estimate(held[kind], "rig.toml")
    due = palpate.estimate("log.csv", "rig.toml")
    np.testing.assert_array_equal(found.status, due.status)
    np.testing.assert_allclose(found.time, due.time, atol=1e-9)  # s: dates are kept to a nanosecond
    np.testing.assert_allclose(found.point, due.point, atol=1e-12)
    with pytest.raises(InputError, match=r"the log: there is no column 'tz'.*Did"):
        palpate.estimate(here.log.drop("tz"), "rig.toml")


class _Frame:
    """A table as pandas has it: columns by their names, each of which NumPy reads."""

    def __init__(self, table: pl.DataFrame) -> None:
        self._table = table
        self.columns = np.array(table.columns, dtype=object)

    def __getitem__(self, name: Any, /) -> Any:
        return self._table[str(name)].to_numpy()


def test_a_mesh_stands_for_a_rig_as_in_the_command(here: Bench) -> None:
    from palpate.cli import main

    found = palpate.estimate("log.csv", mesh="probe.stl", unit="mm")
    assert main(["estimate", "log.csv", "--mesh", "probe.stl", "--unit", "mm", "-o", "by_command.parquet"]) == 0
    same(palpate.Contacts.load("by_command.parquet"), found)
    assert len(found.touches()) == 2
    placed = palpate.estimate("log.csv", "rig.toml", mesh="probe.stl", unit="cm")  # in place of the rig's
    assert placed.point[placed.answered][:, 2].max() == pytest.approx(0.2)


def test_an_estimator_takes_a_body(here: Bench) -> None:
    sensor = palpate.ForceTorque(noise=(0.02, 0.001))
    found = palpate.WrenchEstimator(here.mesh, sensor).update(0.0, WRENCH)
    due = palpate.WrenchEstimator(palpate.Locator(here.mesh), sensor).update(0.0, WRENCH)
    same(found, due)
    live = palpate.load_rig("rig.toml").estimator(rate=200.0)
    assert isinstance(live, palpate.WrenchEstimator)
    assert live.rate == 200.0
    assert live.update(0.0, WRENCH)


def test_poses_and_payloads(tmp_path: Path) -> None:
    pose = palpate.Pose.from_rotation_vector([0.1, 0.2, 0.3], [0.4, 0.5, 0.6])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.translation
    np.testing.assert_array_equal(palpate.Pose.from_matrix(matrix).rotation, pose.rotation)
    np.testing.assert_array_equal(palpate.Pose.from_matrix(np.tile(matrix, (2, 1, 1))).translation[1], pose.translation)
    with pytest.raises(InputError, match=r"last row.*Transpose"):
        palpate.Pose.from_matrix(matrix.T)
    tool = palpate.Payload(mass=0.4, center_of_mass=[0, 0, 0.05])
    assert tool.mass == pytest.approx(0.4)
    np.testing.assert_allclose(tool.weight, [0, 0, -0.4 * 9.80665])
    with pytest.raises(InputError, match=r"payload: .*cannot be stated with a weight"):
        palpate.Payload(weight=[0, 0, -4], mass=0.4)
    tool.save(tmp_path / "payload.toml")
    again = palpate.Payload.load(tmp_path / "payload.toml")
    np.testing.assert_array_equal(again.weight, tool.weight)
    quaternions = np.random.default_rng(2).normal(size=(12, 4))
    rotations = palpate.Pose.from_quaternion(quaternions, np.zeros(3)).rotation
    wrenches = -tool.compensate(np.zeros((12, 6)), rotations)[0]
    found, due = (palpate.identify_payload(wrenches, given) for given in (quaternions, rotations))
    np.testing.assert_array_equal(found.weight, due.weight)
    np.testing.assert_allclose(found.weight, tool.weight, atol=1e-12)


def test_contacts_are_indexed_moved_saved_and_drawn(here: Bench, tmp_path: Path) -> None:
    contacts = here.contacts
    row = int(np.argmax(contacts.answered))
    contact = contacts[row]
    assert isinstance(contact, palpate.ContactEstimate)
    np.testing.assert_array_equal(contact.point, contacts.point[row])
    assert [bool(one) for one in contacts] == contacts.answered.tolist()
    np.testing.assert_array_equal(next(iter(contacts)).force, contacts.force[0])
    move = palpate.Pose.from_quaternion([0, 0, 1, 1], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(contact.in_frame(move).point, move.apply(contact.point))
    np.testing.assert_array_equal(contacts.in_frame(move)[row].point, contact.in_frame(move).point)
    with pytest.raises(InputError, match='frame="base"'):
        contacts.in_frame("base")
    base = palpate.estimate("log.csv", "rig.toml", frame="base")
    np.testing.assert_allclose(base.point[row] - contacts.point[row], [0.1, 0.2, 0.3], atol=1e-3)  # m: it is filtered
    contacts.save(tmp_path / "c.mcap")
    same(palpate.Contacts.load(tmp_path / "c.mcap"), contacts)
    for drawing in (contacts.plot(), contacts.plot(here.mesh), contact.plot(here.mesh), here.mesh.plot()):
        drawing.save(tmp_path / "c.html")
        assert "<canvas" in (tmp_path / "c.html").read_text()


def test_a_contact_is_true_where_one_was_found(here: Bench) -> None:
    assert palpate.locate(WRENCH, here.mesh)
    assert not palpate.locate(np.zeros(6), here.mesh)
    assert palpate.locate([WRENCH, [0] * 6], here.mesh)
    contacts = here.contacts
    assert contacts
    assert not contacts[~contacts.answered]
    assert not contacts[:0]
    for status in palpate.Status:
        with pytest.raises(InputError, match=rf"== palpate.Status.{status.name}"):
            bool(status)
        assert palpate.Status(status.label) is status


def test_a_table_of_pandas_needs_it(here: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    known = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith("pandas"):
            raise ModuleNotFoundError(name)
        return known(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    monkeypatch.setattr(importlib, "import_module", without)
    with pytest.raises(InputError, match="pip install pandas"):
        here.contacts.to_pandas()


def test_the_page_of_the_module_runs(here: Bench) -> None:
    """Its lines, with the readings that they are of."""
    turns = np.random.default_rng(5).normal(size=(12, 4))
    rotations = palpate.Pose.from_quaternion(turns, np.zeros(3)).rotation
    given = {
        "time": 0.0,
        "wrench": WRENCH,
        "rotation": np.eye(3),
        "positions": 0.01 * np.array([[x, y, 0.0] for x in range(4) for y in range(4)]),
        "normals": np.tile([0.0, 0.0, 1.0], (16, 1)),
        "times": np.arange(50) / 50,
        "readings": np.random.default_rng(6).normal(10.0, 0.1, (50, 16)),
        "wrenches": -palpate.Payload(mass=0.4).compensate(np.zeros((12, 6)), rotations)[0],
        "quaternions": turns,
        "mesh": here.mesh,
        "T_base_surface": np.eye(4),
    }
    lines = re.findall(r"^    (.*)\n", str(palpate.__doc__), re.MULTILINE)
    exec("\n".join(lines), given)
    assert len(lines) >= 30


def test_touches_are_a_row_of_each(here: Bench) -> None:
    touches = here.contacts.touches()
    np.testing.assert_allclose([touch.start for touch in touches], [0.51, 1.51], atol=1e-9)
    assert touches[1].peak_force == touches.peak_force.max()


def test_the_front_door_lists_itself() -> None:
    assert sorted(dir(palpate)) == sorted(palpate.__all__)
    import palpate.contact.locate as module

    assert module.locate is palpate.locate


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: palpate.estimate("log.csv", "probe.stl"), 'mesh="probe.stl", unit="mm"'),
        (lambda: palpate.estimate("rig.toml", "log.csv"), 'palpate.estimate("log.csv", "rig.toml")'),
        (lambda: palpate.estimate("log.csv"), 'mesh="probe.stl"'),
        (lambda: palpate.estimate("log.csv", mesh="probe.stl"), "unit"),
        (lambda: palpate.estimate("log.csv", "rig.toml", unit="mm"), 'mesh="probe.stl", unit="mm"'),
        (lambda: palpate.TaxelEstimator(np.eye(3)), "palpate.TaxelBody.anywhere(positions, normals)"),
        (lambda: palpate.Pose.from_quaternion([0, 0, 0.085], [0, 0, 0, 1]), "([0, 0, 0, 1], [0, 0, 0.085])"),
        (lambda: palpate.Pose([0, 0, 0.085], [0, 0, 0, 1]), "palpate.Pose.from_quaternion([0, 0, 0, 1]"),
        (lambda: palpate.locate(WRENCH[:5], palpate.plane([0, 0, 0], [0, 0, 1])), "palpate.locate([0, 0, -5"),
        (lambda: palpate.Payload(0.4), "palpate.Payload(mass=0.4"),
        (lambda: palpate.locate(force=WRENCH[:3], torque=WRENCH[3:]), "palpate.locate([0, 0, -5"),
        (lambda: palpate.Pose.identity() @ WRENCH, "contact.in_frame(pose)"),
        (lambda: palpate.Pose.identity().apply("a"), "pose.apply(contact.point)"),
        (lambda: palpate.estimate("log.csv", "rig.toml")["force"], "contacts[3]"),
        (lambda: palpate.Status("touched"), "palpate.Status.CONTACT"),
        (lambda: palpate.estimate("log.csv", "rig.toml", rate=100.0), '"time": np.arange(len(wrenches)) / rate'),
        (lambda: palpate.estimate("log.csv", "rig.toml", start=1.0), "contacts[contacts.time >= start]"),
        (lambda: palpate.estimate("log.csv", surface="tip"), "palpate.WrenchEstimator(surface,"),
        (lambda: wrong.Cylinder(radius=0.01, height=0.03), "Cylinder(radius=0.01, half_length=0.03)"),
        (lambda: wrong.Ellipsoid(0.03, 0.02, 0.01), "Ellipsoid((0.02, 0.015, 0.03))"),
        (lambda: palpate.Locator("probe.stl", unit="mm")(WRENCH), "locator.run(wrench)"),
        (lambda: palpate.locate([WRENCH], "probe.stl", unit="mm").status == "touched", "palpate.Status.CONTACT"),
    ],
)
def test_what_cannot_work_is_answered_with_the_line(here: Bench, call: Callable[[], object], line: str) -> None:
    with pytest.raises(InputError) as said:
        call()
    assert line in str(said.value)


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("contacts.position", "Write contacts.point"),
        ("contacts.magnitude", "Write np.linalg.norm(contacts.force"),
        ("contacts.events", "Write contacts.touches()"),
        ("contacts.to_csv", 'Write contacts.save("contacts.csv")'),
        ("contacts.show", "Write contacts.plot(mesh)"),
        ("contacts.plot().show", 'Write drawing.save("contacts.html")'),
        ("contacts[0].position", "Write contact.point"),
        ("contacts.touches()[0].contacts", "Write contacts[(contacts.time >= touch.start)"),
        ("palpate.Pose.identity().inv", "Write pose.inverse()"),
        ("palpate.WrenchEstimator(mesh, palpate.ForceTorque(noise=(0.02, 0.001))).estimate", "Write estimator.run("),
        ("palpate.Payload(mass=0.4).subtract", "It has center_of_mass, compensate, covariance"),
        ("palpate.Rig", 'Write palpate.load_rig("rig.toml")'),
        ("palpate.Sphere", "Write palpate.surfaces.Sphere"),
        ("palpate.load_mesh", 'Write palpate.Mesh.load("probe.stl", unit="mm")'),
        ("palpate.plot", "Write contacts.plot(mesh)"),
        ("palpate.locat", "Write palpate.locate"),
    ],
)
def test_a_part_or_a_name_that_is_elsewhere_is_answered_with_the_line(here: Bench, name: str, line: str) -> None:
    with pytest.raises(AttributeError) as said:
        eval(name, {"contacts": palpate.estimate(here.log, "rig.toml"), "mesh": here.mesh, "palpate": palpate})
    assert line in str(said.value)


def test_a_property_that_fails_says_why() -> None:
    @called_as("Broken()")
    class Broken:
        @property
        def inner(self) -> float:
            return getattr(self, "missing")  # noqa: B009 - pyright knows that it is missing

    with pytest.raises(AttributeError, match="'missing'"):
        Broken().inner  # noqa: B018 - it raises


def test_statuses_are_compared_with_words(here: Bench) -> None:
    contacts = here.contacts
    assert 0 < np.count_nonzero(contacts.status == "contact") < len(contacts)
    for status in palpate.Status:
        np.testing.assert_array_equal(contacts.status == status.label, contacts.status == status)
        np.testing.assert_array_equal(contacts.status != status.label, contacts.status != status)
        assert (contacts[0].status == status.label) == (contacts[0].status is status)
        assert (contacts[0].status != status.label) == (contacts[0].status is not status)
        assert status == status.words
    assert type(contacts.answered) is np.ndarray
    codes = np.zeros(1, dtype=np.int8)
    fields = {**vars(contacts.estimate[:1]), "status": codes}
    palpate.ContactEstimate(**fields)
    with pytest.raises(ValueError, match="read-only"):
        codes[0] = 7
