"""The reproduction of `taxel poking`: a small run, how errors are counted, and the page that a run writes."""

from dataclasses import replace

import numpy as np
import pytest

from evidence.taxel_limit import priors_of
from experiments.check import Check
from experiments.taxel_poking.__main__ import AVERAGED, CAD, FOLDER, NOTHING, SMALL, Measured, checks, measured
from experiments.taxel_poking.page import page
from experiments.taxel_poking.study import ALONE, SKIN, Found, Session, alone
from palpate.spatial.pose import Pose
from palpate_lab.simulation.poke_bench import MIX


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


def test_the_page_says_what_was_met_and_what_was_missed() -> None:
    fine = Check("modules", 1e-3, most=1.5e-3, scale=1e3)
    poor = Check("times better", float("nan"), least=2.0)
    assert fine.met
    assert not poor.met
    tables = {name: name.upper() for name in ("singles", "running", "together", "alone", "slow")}
    made = page([fine, poor], tables, 1.0, 2000)
    assert "| modules |  | 1 | <= 1.5 | met |" in made
    assert "| times better |  | nan | >= 2 | **not measured** |" in made
    assert all(part in made for part in tables.values())


def test_the_page_that_is_kept_shows_both_figures() -> None:
    kept = (FOLDER / "README.md").read_text(encoding="utf-8")
    for name in ("figure_4.png", "figure_5.png"):
        assert (FOLDER / name).exists()
        assert name in kept
