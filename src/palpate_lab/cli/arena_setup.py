"""The options of `palpate simulate arena`: checked, and made into the run of a seed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.errors import InputError
from palpate_lab.cli.simulate import require_known

if TYPE_CHECKING:
    from palpate.sensors.marker_ring.model import MarkerRing
    from palpate_lab.cli.arena_ring import RingWear
    from palpate_lab.cli.arena_run import ArenaRun
    from palpate_lab.simulation.arena.layout import ArenaLayout

LAYOUTS = ("random", "paper", "u", "corridor")
ROBOTS = 4
MOST = 200  # robots
USUAL = "paper"  # density
UNIT = 0  # of the simulated ring that is worn


@dataclass(frozen=True)
class ArenaRequest:
    """The settings of a run except its seed; small and plain, to be sent to other processes and compared with a file's.

    Attributes:
        robots: number of robots; None for the layout's own, or 4 in a random arena.
        density: density of random arenas; None for the usual one.
        layout: one of `LAYOUTS`, or a file (.toml) of an arena.
        method: navigation method.
        images: True if the loop closes through images.
        seconds: longest duration of a run [s].
        fault: fault of the first robot; None for none.
        rig: rig that names the model of a ring; None for the usual ring.
    """

    robots: int | None = None
    density: str | None = None
    layout: str = "random"
    method: str = "ours"
    images: bool = False
    seconds: float = 600.0
    fault: str | None = None
    rig: str | None = None

    def check(self) -> None:
        """Check all options before any work.

        Raises:
            InputError: an unknown name, a number out of its range, options that exclude each other, an arena that
                cannot be read or solved, or a rig without a ring.
        """
        from palpate_lab.cli.arena_run import FAULTS, METHODS
        from palpate_lab.simulation.arena.planner import require_solvable
        from palpate_lab.simulation.arena.random_layouts import DENSITIES
        from palpate_lab.simulation.arena.settings import RobotSettings

        if self.own:
            require_solvable(self.arena(0), RobotSettings().radius)  # before a ring is calibrated
        else:
            require_known(self.layout, (*LAYOUTS, "FILE.toml"), "layout")
        require_known(self.method, METHODS, "method")
        if self.fault is not None:
            require_known(self.fault, FAULTS, "fault")
        if self.density is not None:
            require_known(self.density, tuple(DENSITIES), "density")
        if not 0.0 < self.seconds <= 3600.0:
            raise InputError(f"must be more than 0 and at most 3600, not {self.seconds:g}.", where="--seconds")
        if self.robots is not None and not 1 <= self.robots <= MOST:
            raise InputError(f"must be from 1 to {MOST}, not {self.robots}.", where="--robots")
        if self.layout != "random":
            self._check_fixed()
        if self.rig is not None:
            _ring(self.rig)

    @property
    def own(self) -> bool:
        """True if the arena is read from a file: `layout` ends in .toml."""
        return self.layout.endswith(".toml")

    def _check_fixed(self) -> None:
        """Refuse a density or another number of robots for an arena that is not random."""
        if self.density is not None:
            raise InputError(
                f"the layout {self.layout!r} is fixed and has no density.", where="--density", hint="Leave it out."
            )
        there = len(self.arena(0).starts)
        if self.robots not in (None, there):
            raise InputError(
                f"the layout {self.layout!r} always has {there} robots.", where="--robots", hint="Leave it out."
            )

    def arena(self, seed: int) -> ArenaLayout:
        """Return the `ArenaLayout` of a seed; only a random arena depends on it.

        Raises:
            InputError: the file is no valid arena, the layout is unknown, or no random arena can be solved.
        """
        from palpate_lab.cli.arena_file import read_arena
        from palpate_lab.simulation.arena.fixed_layouts import paper_layout, trap_layout
        from palpate_lab.simulation.arena.random_layouts import random_layout

        if self.own:
            return read_arena(self.layout)
        if self.layout == "random":
            return random_layout(seed, self.robots or ROBOTS, self.density or USUAL)
        return paper_layout() if self.layout == "paper" else trap_layout(self.layout)

    def run(self, seed: int) -> ArenaRun:
        """Return the `ArenaRun` of a seed, at its start.

        Raises:
            InputError: an arena that cannot be read or solved, a rig without a ring, or MuJoCo, scikit-fem or OpenCV is
                not installed.
        """
        from palpate_lab.cli.arena_run import ArenaRun, ArenaSettings, RobotFault

        faults = () if self.fault is None else (RobotFault(self.fault),)
        settings = ArenaSettings(
            self.arena(seed),
            seed=seed,
            method=self.method,
            sensing="images" if self.images else "skin",
            seconds=self.seconds,
            faults=faults,
        )
        return ArenaRun(settings, robot_skin(self.rig))

    def key(self) -> dict[str, object]:
        """Return a dict of all that a result depends on except its seed: with the same key a seed has the same result.

        It has the settings by name, Palpate's version, and a digest in place of each file's name.

        Raises:
            OSError: the rig or the file of the arena cannot be read.
        """
        from palpate import __version__

        ring = "" if self.rig is None else sha256(Path(self.rig).read_bytes()).hexdigest()
        key: dict[str, object] = {"palpate": __version__, **vars(self), "rig": ring}
        if self.own:
            key["layout"] = sha256(Path(self.layout).read_bytes()).hexdigest()
        if self.layout == "random":
            key |= {"robots": self.robots or ROBOTS, "density": self.density or USUAL}
        return key


def command(request: ArenaRequest, seed: int) -> str:
    """Return the text of the command line (`palpate simulate arena`) that shows one run."""
    words = ["palpate simulate arena -o run.mcap"]
    for name, value in vars(request).items():
        if value != getattr(ArenaRequest(), name):
            words.append(f"--{name}" if value is True else f"--{name} {value}")
    return " ".join([*words, f"--seed {seed}", "--view"])


def _ring(rig: str | Path) -> MarkerRing:
    """Return the ring that a rig names.

    Raises:
        InputError: the rig is of another sensor, or names no model.
    """
    from palpate.sensors.marker_ring.section import MarkerRingSection
    from palpate.setup import load_rig

    loaded = load_rig(Path(rig))
    if MarkerRingSection.name not in loaded.sensors:
        called = " and ".join(kind.called for kind in loaded.kinds)
        raise InputError(
            f"is a rig of {called}, but robots of the arena wear rings of markers.",
            where=str(rig),
            hint="Name a rig with [marker_ring] and its model.",
        )
    return loaded.resolve().of(MarkerRingSection).ring


@lru_cache(maxsize=1)
def robot_skin(rig: str | None) -> RingWear:
    """Return the skin of every robot, a `RingWear`: the simulated ring, calibrated here or by the rig's model.

    It is made once for all.

    Raises:
        InputError: the rig is of another sensor or names no model, or scikit-fem or OpenCV is not installed.
    """
    from palpate_lab.cli.arena_ring import RingWear

    return RingWear.made(UNIT, None if rig is None else _ring(rig))
