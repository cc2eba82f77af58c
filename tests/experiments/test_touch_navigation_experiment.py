"""The reproduction of `marker ring`'s showcases: what is run, how it is counted and kept, and the page of it."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from claims.papers.touch_navigation import conditions as planned
from claims.papers.touch_navigation import study
from claims.papers.touch_navigation.conditions import BUILT, FULL, JUDGED, Condition, Sizes, conditions
from claims.papers.touch_navigation.rows import FOLDER, differing, draw, figures_of, parts
from claims.papers.touch_navigation.study import BIN, BINS, Found, Outcome, Runs, found, run, stamp
from claims.row import expected
from palpate_lab.cli import arena_run
from palpate_lab.cli.arena_ring import RingSense, RingWear
from tests.support.templates import places

LATE = float("nan")


def made_up(condition: Condition, *arrived: float, newtons: float = 2.0, digest: str = "") -> Outcome:
    """Arrivals [s], and contacts that are all as strong, but for one moment in a hundred of 6 N."""
    count = len(arrived)
    forces = np.zeros(BINS, dtype=int)
    forces[int(newtons / BIN)] += 990
    forces[int(6.0 / BIN)] += 10
    whole, states = (1,) * count, ("arrived: within reach of the goal",) * count
    said = digest or condition.key
    ways = tuple((0.1, 0.1 * k, 0.0, 1.0, 0.1 * k, 0.0) for k in range(count)) if condition.traced else ()
    boxes = ((1.99, 1.01, 0.0) * 4, (2.09, 1.01, 0.1) * 4) if condition.traced else ()
    return Outcome(
        condition, stamp(), arrived, (3.0,) * count, (6.1,) * count, whole, whole, states, tuple(forces.tolist()), 0.1,
        200.0, 10.0, said, ways, boxes,
    )  # fmt: skip


def seeds(*arrivals: tuple[float, ...], first: int = JUDGED) -> Found:
    made = [Condition("ours", "paper", first + k) for k in range(len(arrivals))]
    return Found([made_up(each, *times) for each, times in zip(made, arrivals, strict=True)])


def test_no_seed_that_was_used_while_building_is_judged() -> None:
    made = conditions(FULL)
    assert JUDGED not in BUILT
    assert min(each.seed for each in made) >= JUDGED
    counts = {name: sum(each.name == name for each in made) for name in {each.name for each in made}}
    assert counts["ours"] == 100
    assert counts["images"] >= 40
    assert {"figure 11 ours", "no memory", "dense", "trap u", "50 robots", "fault blind", "paper-turned"} <= set(counts)


def test_what_is_run_can_be() -> None:
    """Every condition names what the loop knows, but for whether it ends well."""
    for each in {each.name: each for each in conditions(Sizes(1, 1, 1, 1, (2,)))}.values():
        settings = planned.arena_settings(each)
        assert settings.method in arena_run.METHODS
        assert all(fault.kind in arena_run.FAULTS for fault in settings.faults)


def test_robots_runs_times_and_forces_are_counted() -> None:
    runs = seeds((100.0, 120.0), (80.0, LATE), (LATE, 140.0))
    assert runs.robots == pytest.approx(100.0 * 4 / 6)
    assert runs.whole == pytest.approx(100.0 / 3)
    assert runs.healthy == pytest.approx(100.0 * 2 / 3)
    assert runs.median == pytest.approx(110.0)
    assert runs.force() == pytest.approx(2.0, abs=1.01 * BIN)
    assert runs.force(0.995) == pytest.approx(6.0, abs=1.01 * BIN)
    assert runs.greatest == pytest.approx(6.1)
    assert runs.speed == pytest.approx(20.0)
    assert len(runs.of(seeds((1.0, 1.0), first=JUDGED + 1))) == 1
    assert np.isnan(Found([]).robots)


def test_an_outcome_is_read_as_it_was_written() -> None:
    outcome = made_up(Condition("a", "figure 11", 3, traced=True), 1.5, 0.1 + 0.2)
    assert Outcome.of(json.loads(json.dumps(asdict(outcome)))) == outcome
    late = Outcome.of(asdict(outcome) | {"arrived": [None]})
    assert np.isnan(late.arrived[0])


def test_who_is_stopped_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran = list[int]()

    def fake(condition: Condition) -> Outcome:
        if condition.seed == 12 and not ran[1:]:
            raise KeyboardInterrupt
        ran.append(condition.seed)
        return made_up(condition, 1.0)

    monkeypatch.setattr(study, "run", fake)
    wanted = [Condition("ours", "paper", seed) for seed in (11, 12, 13)]
    wanted.append(replace(wanted[0], name="1 robot of them"))
    kept = tmp_path / "kept" / "runs.jsonl"
    with pytest.raises(KeyboardInterrupt):
        found(wanted, kept)
    assert ran == [11]
    with kept.open("a") as file:
        file.write('{"cut off')
    ran.append(0)
    kept.write_text(kept.read_text() + "\n")
    assert {name: len(each) for name, each in found(wanted, kept).items()} == {"ours": 3, "1 robot of them": 1}
    assert ran == [11, 0, 12, 13]
    monkeypatch.setattr(study, "stamp", lambda: "other code")
    found(wanted[:1], kept, any_code=True)
    assert ran == [11, 0, 12, 13]
    found(wanted[:1], kept)
    assert ran == [11, 0, 12, 13, 11]


def test_words_do_not_change_the_stamp(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(study, "CODE", ("one.py",))
    monkeypatch.setattr(study.palpate, "__file__", str(tmp_path / "palpate" / "__init__.py"))
    stamps = list[str]()
    for text in ('"""Words."""\nx = 1\n', '"""Others."""\n\n# why\nx = 1  # one\n', "x = 2\n"):
        (tmp_path / "one.py").write_text(text)
        stamps.append(study.stamp.__wrapped__())
    assert stamps[0] == stamps[1] != stamps[2]


class Bare(RingSense):
    """Feels what truly touches."""

    def __init__(self, *_: object, **__: object) -> None:
        self.frame = np.zeros((2, 2, 3), dtype=np.uint8)

    def look(self, truth: np.ndarray, *, dark: bool = False) -> None:
        """Kept."""
        self.truth = None if dark else truth[:, :2]

    def feel(self, time: float) -> np.ndarray | None:
        """The first two columns."""
        return self.truth


def test_a_short_run_comes_out_the_same_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arena_run, "RingSense", Bare)
    monkeypatch.setattr(study, "_worn", lambda: object.__new__(RingWear))
    monkeypatch.setattr(planned, "LIMIT", 1.0)
    condition = Condition("trap", "trap u", JUDGED, method="paper", traced=True)
    one, two = run(condition), run(replace(condition, again=1))
    assert one.digest == two.digest
    assert one.digest != run(replace(condition, seed=JUDGED + 1)).digest
    assert one.seconds == pytest.approx(1.0, abs=0.05)
    way = np.reshape(one.ways[0], (-1, 3))
    assert len(way) == 2  # every half second
    assert way[1, 0] - way[0, 0] == pytest.approx(0.025, abs=0.005)  # 50 mm/s, but for the start
    assert sum(one.forces) == 0


def test_a_run_fills_the_page_with_what_was_run_and_what_was_not(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    eleven = Found([made_up(Condition("figure 11 ours", "figure 11", 1, traced=True), 90.0, 100.0, 95.0, LATE)])
    whole = Runs({"ours": seeds((60.0, 70.0, 80.0, 90.0)), "figure 11 ours": eleven})
    whole |= {f"again {k}": Found([made_up(Condition("", "paper", 1), 1.0, digest=f"{k}")]) for k in (1, 2)}
    got = figures_of(whole)
    assert got["robots"] == 100.0
    assert got["figure_11"] == 0.0
    assert got["again"] == differing(whole) == 1.0
    assert np.isnan(got["dense"])
    assert set(got) == set(figures_of(Runs()))
    rows = expected(FOLDER, got)
    assert len(rows) == 17
    assert {row.got for row in rows if row.passed is False} >= {"not measured", "0"}
    draw(whole, tmp_path)
    assert (tmp_path / "figure_11.png").stat().st_size > 10_000
    made = parts(whole)
    assert set(made) == places(FOLDER)
    assert "not run" in str(made["many"])
