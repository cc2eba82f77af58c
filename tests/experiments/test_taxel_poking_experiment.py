"""The reproduction of `taxel poking`: a small run, how errors are counted, and the page that a run writes."""

from dataclasses import replace

import numpy as np
import pytest

from claims.evidence.taxel_limit import priors_of
from claims.papers.taxel_poking.rows import AVERAGED, CAD, FOLDER, NOTHING, SMALL, Measured, checks, measured, parts
from claims.papers.taxel_poking.study import ALONE, SKIN, Found, Session, alone
from palpate.spatial.pose import Pose
from palpate_lab.simulation.poke_bench import MIX
from tests.support.templates import places


@pytest.fixture(scope="module")
def small() -> Measured:
    """Two sessions, one of them with modules."""
    return measured(SMALL)


def test_a_rigid_motion_is_no_relative_error() -> None:
    motion = Pose.from_rotation_vector(np.array([0.0, 0.0, 0.1]), np.array([1e-3, 0.0, 2e-3]))
    found = Found.of(motion.apply(SKIN.places.positions))
    assert found.relative_worst < 1e-12
    assert found.mean > 1e-3
    assert found.mean <= found.worst


def test_one_error_at_a_time_is_one_error() -> None:
    assert alone("noise only") == replace(alone("+ bias"), bias_force=0.0, bias_torque=0.0)
    kept = [name for name in vars(MIX) if any(getattr(alone(error), name) == getattr(MIX, name) for error in ALONE)]
    assert set(kept) == set(vars(MIX))
    assert priors_of(MIX).common_angle == MIX.common_angle
    assert priors_of(alone("+ frames")).cross_talk == 0.0


def test_running_means_begin_with_the_first_dataset_and_get_better() -> None:
    singles, running = Session(7, 400).averaged(surface=False)
    assert len(singles) == len(running) == 7
    assert running[0] == singles[0]
    assert running[-1].mean < np.mean([each.mean for each in singles])


def test_a_small_run_has_all_methods(small: Measured) -> None:
    assert set(small.together) == {"pooled, free", "pooled", NOTHING, CAD}
    assert small.together[NOTHING][0].relative < 1.5e-3  # places to each other, from 300 pokes: 0.5 mm
    averaged = Session(200, SMALL.pokes).together([AVERAGED])[AVERAGED]
    assert averaged.mean == pytest.approx(small.running["surface"][0][-1].mean, rel=1e-9)
    assert len(checks(small)) == 9


def test_a_run_fills_the_page(small: Measured) -> None:
    assert {*parts(small), "took", "pokes"} == places(FOLDER)


def test_the_page_that_is_kept_shows_both_figures() -> None:
    kept = (FOLDER / "README.md").read_text(encoding="utf-8")
    for name in ("figure_4.png", "figure_5.png"):
        assert (FOLDER / name).exists()
        assert name in kept
