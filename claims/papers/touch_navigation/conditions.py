"""Everything that is run, by section of the page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from palpate_lab.cli.arena_run import ArenaSettings, RobotFault
from palpate_lab.simulation.arena.fixed_layouts import paper_layout, trap_layout
from palpate_lab.simulation.arena.layout import ArenaLayout
from palpate_lab.simulation.arena.random_layouts import random_layout

BUILT = range(1000)  # seeds that were looked at while building
JUDGED = 20_000  # the first of those that are judged: nothing was chosen on them
LIMIT = 600.0  # s of a run
BASELINES = {"paper": "to the goal's side", "paper-turned": "always 90 deg", "paper-random": "either way, by chance"}
ABLATIONS = {  # name -> what differs from ours
    "binary touch": {"touch": "binary"},
    "one contact only": {"touch": "one"},
    "no push": {"method": "no-push"},
    "no memory": {"method": "no-memory"},
    "odometry alone": {"pose": "odometry"},
}
FAULTS = {
    "blind": "a blind camera",
    "torn": "a torn skin",
    "stuck-wheel": "a stuck wheel",
    "wrong-goal": "a wrong goal",
}
TRAPS = {"u": "a U-shaped trap", "corridor": "a corridor one and a half robots wide"}
COUNTS = (1, 4, 16, 50)  # robots


@dataclass(frozen=True)
class Condition:
    """One run.

    Attributes:
        name: in tables; runs that differ in the seed only share it.
        arena: "figure 11"; "trap u" and the like; or a density of random ones.
        seed: of the arena, where it is drawn, and of all noise.
        robots: how many, in an arena that is drawn.
        method, sensing, touch, pose: of `ArenaSettings`.
        fault: of the first robot, "": none.
        again: runs that differ in it only must be the same.
        traced: ways and boxes are kept.
    """

    name: str
    arena: str
    seed: int
    robots: int = 4
    method: str = "ours"
    sensing: str = "skin"
    touch: str = "all"
    pose: str = "tracker"
    fault: str = ""
    again: int = 0
    traced: bool = False

    @property
    def key(self) -> str:
        """What is the same for runs that must come out the same; the name is none of it."""
        fields = {**vars(self)}
        return " ".join(f"{name}={fields[name]}" for name in sorted(fields) if name != "name")


@dataclass(frozen=True)
class Sizes:
    """How many seeds.

    Args:
        many: of ours at the paper's density, and dense.
        few: of what is compared with it.
        fixed: of noise in an arena that is given.
        again: runs that are run twice.
        counts: numbers of robots.
    """

    many: int
    few: int
    fixed: int
    again: int
    counts: tuple[int, ...] = COUNTS

    def at_most(self, seeds: int) -> Sizes:
        many, few, fixed, again = (min(seeds, each) for each in (self.many, self.few, self.fixed, self.again))
        return Sizes(many, few, fixed, again, self.counts)


FULL = Sizes(100, 40, 10, 4)


def arena_settings(condition: Condition) -> ArenaSettings:
    faults = (RobotFault(condition.fault),) if condition.fault else ()
    given = {name: getattr(condition, name) for name in ("seed", "method", "sensing", "touch", "pose")}
    return ArenaSettings(_layout(condition), **given, seconds=LIMIT, faults=faults)


def _layout(condition: Condition) -> ArenaLayout:
    if condition.arena == "figure 11":
        return paper_layout()
    if condition.arena.startswith("trap "):
        return trap_layout(condition.arena.removeprefix("trap "))
    return random_layout(condition.seed, condition.robots, condition.arena)


def conditions(sizes: Sizes = FULL) -> list[Condition]:
    """The most telling first: a run that is stopped early has those."""
    made = [each for size, *kind in _kinds() for each in seeded(getattr(sizes, size), *kind)]
    for count in sizes.counts:
        made += seeded(max(1, min(sizes.fixed, 40 // count)), f"{count} robots", "paper", {"robots": count})
    names = dict.fromkeys(each.name for each in made)
    return [each for name in names for each in made if each.name == name]


def seeded(count: int, name: str, arena: str, options: Mapping[str, Any]) -> list[Condition]:
    first = Condition(name, arena, JUDGED, **options)
    return [replace(first, seed=seed) for seed in range(JUDGED, JUDGED + count)]


def _kinds() -> Iterator[tuple[str, str, str, dict[str, Any]]]:
    """How many of `Sizes`, name, arena, and what differs from ours."""
    for method in ("ours", *BASELINES):
        yield "fixed", f"figure 11 {method}", "figure 11", {"method": method, "traced": True}
    yield "many", "ours", "paper", {}
    yield "few", "images", "paper", {"sensing": "images"}
    yield from (("few", name, "paper", options) for name, options in ABLATIONS.items())
    yield from (("few", f"fault {fault}", "paper", {"fault": fault}) for fault in FAULTS)
    yield "many", "dense", "dense", {}
    for trap in TRAPS:
        yield "fixed", f"trap {trap}", f"trap {trap}", {"traced": True}
        yield "fixed", f"trap {trap} paper", f"trap {trap}", {"method": "paper"}
    yield from (("again", f"again {again}", "paper", {"again": again}) for again in (1, 2))
    yield from (("few", method, "paper", {"method": method}) for method in BASELINES)
    yield "few", "ours sparse", "sparse", {}
    yield from (("few", f"{method} sparse", "sparse", {"method": method}) for method in BASELINES)
    yield "few", "paper alone", "paper", {"method": "paper", "robots": 1}
    yield "few", "paper binary touch", "paper", {"method": "paper", "touch": "binary"}
