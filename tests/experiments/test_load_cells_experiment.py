"""The reproduction of `load cells`: the paper's estimator by its own equations, and the page that a run writes."""

import numpy as np
import pytest

from claims.papers.load_cells.literal import Literal
from claims.papers.load_cells.rows import FOLDER, TABLE_1, checks, errors, figures_of, parts, sizes, studies, table_1
from claims.papers.load_cells.study import Answer, Study
from palpate_lab.simulation.ball_on_ellipse import FINGERTIP
from palpate_lab.simulation.cell_array import LAYOUTS, random_cells
from palpate_lab.simulation.contacts import contact_wrenches, directed_forces
from tests.support.templates import places


def _touches(count: int = 300) -> tuple[np.ndarray, np.ndarray, np.ndarray, Literal]:
    """Voltages of perfect cells, forces, points, and the cells."""
    rng = np.random.default_rng(0)
    cells = random_cells(LAYOUTS[4], rng)
    point, normal = FINGERTIP.foot(rng.uniform(-10e-3, 10e-3, count), rng.uniform(-14e-3, 14e-3, count))
    azimuth = rng.uniform(0, 2 * np.pi, count)
    force = directed_forces(normal, rng.uniform(1, 4, count), rng.uniform(0, 0.5, count), azimuth)
    volts = cells.voltages(contact_wrenches(point, normal, force, np.zeros(count))).reshape(count, 4, 3)
    return volts, force, point, Literal(cells.sensitivity, cells.position)


def test_the_papers_equations_give_back_force_and_point_of_perfect_cells() -> None:
    volts, force, point, true = _touches()
    found_force, found_point = true.estimate(volts)
    np.testing.assert_allclose(found_force, force, atol=1e-12)
    np.testing.assert_allclose(found_point, point, atol=1e-12)


def test_its_slopes_are_those_of_differences() -> None:
    volts, _, _, true = _touches(20)
    numbers = np.concatenate([true.sensitivity.ravel(), 1e3 * true.position.ravel()])

    def flat(x: np.ndarray) -> np.ndarray:
        force, point = Literal(x[:36].reshape(4, 3, 3), 1e-3 * x[36:].reshape(4, 3)).estimate(volts)
        return np.concatenate([force, 1e3 * point], axis=1).ravel()

    step = 1e-5
    measured = np.stack([(flat(numbers + e) - flat(numbers - e)) / (2 * step) for e in step * np.eye(48)], axis=1)
    np.testing.assert_allclose(true._slopes(volts), measured, atol=1e-7)


def test_its_calibration_finds_cells_that_answer_alike() -> None:
    """Not the cells themselves: under a rigid frame these are not determined."""
    volts, force, point, _ = _touches()
    made = Literal.fit(volts, force, point, LAYOUTS[4])
    found_force, found_point = made.estimate(volts)
    assert np.abs(found_force - force).max() < 1e-6
    assert np.abs(found_point - point).max() < 1e-8


def test_errors_are_counted_as_the_paper_counts_them() -> None:
    mean, most, deviation, rmse = sizes(np.array([1.0, -3.0, 2.0, 0.0]))
    assert (mean, most) == (0.0, 3.0)
    assert rmse == deviation == pytest.approx(np.sqrt(3.5))
    for _, most, deviation, rmse in TABLE_1.values():
        assert deviation <= rmse * 1.0001 <= most


@pytest.fixture(scope="module")
def thin() -> dict[str, Study]:
    """All benches, forty times thinner."""
    return studies(thin=40)


@pytest.fixture(scope="module")
def small(thin: dict[str, Study]) -> Study:
    return thin["rigid"]


def test_a_perfect_answer_has_no_error_but_the_references(small: Study) -> None:
    run = small.second
    found = errors(small, Answer(run.wrench[:, :3], run.point, run.torque))
    assert len(found) == 12
    assert found["|c|"][1] == found["|p|, truth"][1] == 0
    assert found["p_x"][3] == pytest.approx(17e-3, rel=0.05)  # 2,150 samples
    lines = table_1(found)
    assert all(len(line) == 9 for line in lines)
    assert lines[3][1:5] == ["37.79", "240.6", "17.07", "41.47"]


def test_a_thin_run_reaches_the_figures_of_the_rigid_bench(small: Study) -> None:
    got = figures_of(small, small.ours)
    assert got["position_rmse"] <= 45e-6
    assert got["position_max"] <= 220e-6
    assert got["force_rmse"] <= 5e-3


def test_a_run_fills_the_page(thin: dict[str, Study]) -> None:
    assert len(list(checks(thin))) == 12
    assert set(parts(thin)) == places(FOLDER)


def test_the_page_that_is_kept_is_one_of_a_run_that_met_everything() -> None:
    kept = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert "missed" not in kept
    for name in ("paths.png", "forces.png"):
        assert (FOLDER / name).exists()
        assert name in kept
