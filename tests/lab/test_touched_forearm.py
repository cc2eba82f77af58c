"""The touched forearm: statics and friction hold in its truth, its sensors read what is true, its files are read."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.files.ground_truth import read_ground_truth
from palpate.files.logs import read_recording
from palpate.files.models import read_model
from palpate.sensors.taxels.intensity import Intensity
from palpate.sensors.taxels.section import SkinSection
from palpate.setup.load import load_rig
from palpate.signals.drift import Drift
from palpate.signals.payload import Payload
from palpate.signals.recording import CELLS, ORIENTATION
from palpate_lab.simulation.skin_bench import PaperSheet, Patch, Rolled, press
from palpate_lab.simulation.touched.body import simulate_physics
from palpate_lab.simulation.touched.files import link_mesh, write_forearm
from palpate_lab.simulation.touched.run import ForearmRun, simulate_forearm, simulate_free, simulate_presses
from palpate_lab.simulation.touched.sensors import motion
from palpate_lab.simulation.touched.settings import GRAVITY, ForearmSettings

pytest.importorskip("mujoco")

SILENT = {"force_noise": 0.0, "torque_noise": 0.0, "cell_noise": 0.0, "bias": (0.0,) * 6}
SHORT = ForearmSettings(seconds=8.0, quiet=1.0, wrench_rate=200)


@pytest.fixture(scope="module")
def run() -> ForearmRun:
    return simulate_forearm(np.random.default_rng(5), SHORT)


def _pushes(run: ForearmRun) -> tuple[np.ndarray, np.ndarray]:
    """Normal and tangential force [N] of each contact."""
    truth = run.truth
    normal = -np.einsum("ij,ij->i", truth.force, truth.normal)
    return normal, np.linalg.norm(truth.force + normal[:, None] * truth.normal, axis=1)


def test_the_sensor_bears_what_the_contacts_do(run: ForearmRun) -> None:
    """The engine's own sensor, less the weight, is the sum of the engine's contacts: to rounding, in motion too."""
    mount, truth = run.settings.mount, run.truth
    force = mount.rotate(truth.force)
    total = np.zeros((len(run.skin.time), 6))
    np.add.at(total, truth.frame, np.concatenate([force, np.cross(mount.apply(truth.point), force)], axis=1))
    every = run.settings.wrench_rate // run.settings.skin_rate
    np.testing.assert_allclose(run.contacts[::every], total, atol=1e-9)
    assert np.linalg.norm(total[:, :3], axis=1).max() > 5.0


def test_contacts_keep_to_the_friction_cone_and_some_slide(run: ForearmRun) -> None:
    normal, aside = _pushes(run)
    assert (normal > 0.0).all()
    assert (aside <= run.settings.friction * normal * (1 + 1e-6) + 1e-9).all()
    sliding = aside > 0.999 * run.settings.friction * normal
    assert 0.02 < sliding.mean() < 0.9
    firm = normal > 1.0
    assert run.truth.speed[sliding & firm].max() > 0.01
    assert np.median(run.truth.speed[~sliding & firm]) < 1e-3


def test_contacts_lie_on_the_link_while_their_touch_lasts_and_overlap(run: ForearmRun) -> None:
    truth, sheet = run.truth, run.settings.sheet
    depth = sheet.radius - np.linalg.norm(truth.point[:, :2], axis=1)
    assert depth.min() > -1e-9
    assert depth.max() < 2e-4
    assert np.abs(truth.normal[:, 2]).max() < 1e-9
    for touch in run.touches:
        mine = truth.touch == touch.number
        assert mine.any()
        assert touch.start - 0.02 < truth.time[mine].min() < touch.start + 0.2
        assert touch.end - 0.2 < truth.time[mine].max() < touch.end + 0.05
    assert set(np.bincount(truth.frame)) >= {1, 2, 3}
    assert truth.time.min() >= run.settings.quiet


def test_the_sensor_shows_weight_where_nothing_touches() -> None:
    """R^T m g at the centre of mass, in whatever orientation the sensor is."""
    settings = replace(SHORT, touches=1)
    rotations, _ = motion(settings, 4000, np.random.default_rng(0))
    found = simulate_physics(settings, (), rotations)
    weight = settings.mass * np.einsum("nji,j->ni", rotations, [0.0, 0.0, -GRAVITY])
    centre = settings.mount.apply(np.array(settings.centre))
    np.testing.assert_allclose(found.wrench, np.concatenate([weight, np.cross(centre, weight)], axis=1), atol=1e-9)
    assert np.ptp(weight, axis=0).min() > 0.1  # it did turn
    assert not len(found.frame)


def test_a_free_log_obeys_newton() -> None:
    """In the base, the sensor pushes with -F, so m c'' = m g - F: by second differences of the path of the centre."""
    settings = replace(SHORT, wrench_rate=1000, **SILENT)
    log = simulate_free(np.random.default_rng(1), settings, 8.0, settings.mass)
    rotations, _ = motion(settings, 8000, np.random.default_rng(1))  # the first that is drawn
    path = rotations @ settings.mount.apply(np.array(settings.centre))
    acceleration = (path[20:] - 2 * path[10:-10] + path[:-20]) / 0.01**2
    force = np.einsum("nij,nj->ni", rotations, log.wrenches()[:, :3])[10:-10]
    np.testing.assert_allclose(force, settings.mass * ([0.0, 0.0, -GRAVITY] - acceleration), atol=2e-4)
    assert np.abs(settings.mass * acceleration).max() > 0.005


def test_touches_beside_the_skin_press_no_cell() -> None:
    settings = replace(SHORT, unseen=1.0, **SILENT)
    run = simulate_forearm(np.random.default_rng(2), settings)
    assert len(run.truth.time) > 100
    assert not run.truth.seen.any()
    assert np.abs(run.truth.point[:, 2]).min() > settings.covered
    np.testing.assert_array_equal(np.ptp(run.skin.channels[CELLS], axis=0), 0.0)
    assert np.abs(run.contacts[:, :3]).max() > 2.0


def test_cells_read_the_normal_forces_as_the_bench_presses_them() -> None:
    """One touch on a sheet without noise: each cell as `skin_bench.press` has it for the same disc, up to rounding."""
    settings = replace(SHORT, touches=1, unseen=0.0, seconds=6.0, unequal=0.0, **SILENT)
    run = simulate_forearm(np.random.default_rng(4), settings)
    normal, _ = _pushes(run)
    at = int(normal.argmax())
    truth, sheet = run.truth, settings.sheet
    radius = run.touches[int(truth.touch[at])].radius
    disc = np.cbrt(0.75 * normal[at] / settings.modulus / (1 / radius + 0.5 / sheet.radius))
    column = np.arctan2(truth.point[at, 1], truth.point[at, 0]) * sheet.radius / sheet.pitch
    row = truth.point[at, 2] / sheet.pitch + 0.5 * (sheet.rows - 1)
    patch = Patch(float(row), float(column), float(disc / sheet.pitch), float(normal[at]))
    counts = run.sheet.rest + PaperSheet.counts(press(sheet, [patch]).loads)
    steepest, share = 100.0, 0.03 * normal[at]  # counts per newton, and what a cell's share may err by
    seen = run.skin.channels[CELLS][truth.frame[at]]
    assert np.abs(seen - counts).max() <= 0.5 + steepest * share
    pressed = counts > run.sheet.rest + 40.0  # beyond the steep range
    assert pressed.any()
    assert np.abs(seen - counts)[pressed].max() <= 0.5 + 11.5 * share
    assert float(truth.share[at]) == pytest.approx(1.0)


def test_presses_are_settled_where_they_are_held() -> None:
    settings = replace(SHORT, touches=4, force=(2.0, 12.0))
    run = simulate_presses(np.random.default_rng(8), 4, settings)
    normal, _ = _pushes(run)
    assert len(run.stationary) == 4
    for frame in run.stationary.tolist():
        rows, before = run.truth.at(frame), run.truth.at(frame - 5)
        assert sorted(run.touches[k].slot for k in run.truth.touch[rows].tolist()) == [0, 1, 2, 3]
        assert run.truth.speed[rows].max() < 5e-3
        np.testing.assert_allclose(normal[rows], normal[before], rtol=0.02)
        gaps = run.truth.point[rows][:, None] - run.truth.point[rows][None] + np.eye(4)[..., None]
        assert np.linalg.norm(gaps, axis=-1).min() > 0.02  # 30 mm along the surface, less what some slid


def test_drift_moves_the_zero_and_the_weight_and_nothing_else() -> None:
    drift = Drift([0.01] * 3 + [1e-4] * 3, weight=0.5)
    settings = [replace(SHORT, seconds=4.0, drift=each) for each in (drift, None)]
    made = [simulate_forearm(np.random.default_rng(9), each) for each in settings]
    assert made[0].mass != made[0].settings.mass
    assert made[1].mass == made[1].settings.mass
    assert len(made[0].truth.time) > 0
    np.testing.assert_array_equal(made[0].truth.force, made[1].truth.force)
    assert np.ptp(made[0].zero, axis=0).min() > 0.0
    np.testing.assert_array_equal(made[1].zero, np.broadcast_to(SHORT.bias, made[1].zero.shape))


def test_the_files_are_read_by_palpate(run: ForearmRun, tmp_path: Path) -> None:
    """Both sensors from one recording, the models and the truth, as they were written."""
    pytest.importorskip("rosbags")
    late = replace(run, skin=replace(run.skin, time=run.skin.time - 0.015))  # a clock that is behind: 2 frames before 0
    write_forearm(late, tmp_path, simulate_free(np.random.default_rng(0), run.settings, 2.0))
    rig, log = load_rig(tmp_path / "both.toml"), tmp_path / "both.mcap"
    wrench, skin = (read_recording(log, rig.layout(sensor)) for sensor in ("force_torque", "skin"))
    np.testing.assert_allclose(wrench.wrenches(), run.wrench.wrenches())
    turns = wrench.channels[ORIENTATION]
    known = np.isfinite(turns).all(axis=1)
    assert known.mean() > 0.99
    np.testing.assert_allclose(np.abs((turns * run.wrench.channels[ORIENTATION])[known].sum(axis=1)), 1.0, atol=1e-6)
    np.testing.assert_array_equal(skin.channels[CELLS], run.skin.channels[CELLS][2:])
    np.testing.assert_allclose(skin.time, run.skin.time[2:] - 0.015, atol=1e-9)
    np.testing.assert_allclose(rig.resolve().of(SkinSection).map.centres, run.settings.sheet.layout().centres)
    np.testing.assert_allclose(rig.mount().apply(np.eye(3)), run.settings.mount.apply(np.eye(3)))
    assert read_model(tmp_path / "payload.toml", Payload).mass == pytest.approx(run.settings.mass)
    curve = read_model(tmp_path / "intensity.toml", Intensity).curves[0]
    forces = np.linspace(0.0, 19.0, 50)
    np.testing.assert_allclose(curve.intensity(forces), PaperSheet.counts(forces), atol=1e-9)
    truth = read_ground_truth(tmp_path / "truth.csv")
    np.testing.assert_allclose(truth.point, run.truth.point, atol=1e-6)
    assert (tmp_path / "free.mcap").stat().st_size > 1000
    assert "both.mcap" in (tmp_path / "README.txt").read_text()


def test_the_mesh_is_the_closed_cylinder() -> None:
    import trimesh

    mesh = trimesh.Trimesh(*link_mesh(SHORT), process=False)
    assert mesh.is_watertight
    volume = np.pi * SHORT.sheet.radius**2 * 2 * SHORT.half_length
    assert mesh.volume == pytest.approx(volume, rel=1e-3)  # and not inside out
    assert np.ptp(mesh.vertices[:, 2]) == pytest.approx(2 * SHORT.half_length)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"wrench_rate": 300}, "divide the 1000 Hz"),
        ({"touches": 6}, "1 to 5"),
        ({"friction": 0.0}, "friction must be positive"),
        ({"lean": -1.0}, "lean must not be negative"),
        ({"force": (3.0, 2.0)}, "larger one last"),
        ({"sheet": Rolled(radius=np.inf)}, "round a cylinder"),
        ({"bare": 0.01}, "30 mm"),
    ],
)
def test_what_cannot_be_built_is_refused(wrong: dict[str, object], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        replace(SHORT, **wrong)


def test_presses_of_nothing_are_refused() -> None:
    with pytest.raises(InputError, match="configurations"):
        simulate_presses(np.random.default_rng(0), 0)


def test_without_the_engine_one_sentence_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match="touched forearm: the simulation needs MuJoCo"):
        simulate_forearm(np.random.default_rng(0), SHORT)
