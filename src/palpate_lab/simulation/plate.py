"""A plate that bends on springs, which are load cells of one axis: statics by Rayleigh and Ritz, and its session."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate_lab.simulation.contacts import directed_forces

SIDE, THICK, INSET, RATING = 0.3, 0.01, 0.01, 10.0  # m, of the plate and of its cells from the edges; N of a cell
RATE, STANDS, RESTS = 50.0, 2.0, 1.0  # Hz, s
SPRING, BENDING = 2e5, 4e4  # N/m of a cell; N m^2 times m^2 of each bending mode: a corner sinks as much as its cell
_RIG = """[surface]
mesh = "plate.stl"
unit = "m"

[load_cells]
model = "plate.toml"   # of `palpate calibrate load-cells`; not there yet while calibrating
axes = ["z"]
columns = {columns}
positions = {positions}

[estimate]
tare = 0.9
"""


@dataclass(frozen=True)
class Plate:
    """A square plate, its upper face at z = 0, on k cells at z = -THICK.

    Args:
        position: (k, 3) [m] of the cells.
        gain: (k,) [V/N].
        spring: (k,) [N/m].
        bow: (k,) error of a cell in the middle of its rating, over it.
        crossed: (k, 2) share of its shear that a cell reads.
        noise: standard deviation of a reading, over the rating.
    """

    position: Float[np.ndarray, "k 3"]
    gain: Float[np.ndarray, " k"]
    spring: Float[np.ndarray, " k"]
    bow: Float[np.ndarray, " k"]
    crossed: Float[np.ndarray, "k 2"]
    noise: float = 2e-4

    @classmethod
    def drawn(cls, rng: np.random.Generator, cells: int = 4, error: float = 1e-3) -> Plate:
        """Draw a plate whose cells differ by 1 % in gain, by 5 % in stiffness, and err by a share of their rating."""
        turn = np.pi / 4 + 2.0 * np.pi * np.arange(cells) / cells
        place = np.stack([np.cos(turn), np.sin(turn), np.zeros(cells)], axis=1)
        place *= (SIDE / 2 - INSET) / np.abs(place[:, :2]).max(axis=1, keepdims=True)
        place[:, 2] = -THICK
        gain, spring = (
            0.1 * (1.0 + 0.01 * rng.standard_normal(cells)),
            SPRING * (1.0 + 0.05 * rng.standard_normal(cells)),
        )
        return cls(place, gain, spring, error * rng.uniform(-1, 1, cells), 5e-4 * rng.standard_normal((cells, 2)))

    def loads(self, points: Float[np.ndarray, "n 3"], forces: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n k"]:
        """Return what each cell carries (n, k) [N]: the least energy of springs and bending, less a force's work."""
        modes, _ = _modes(self.position)
        stiffness = (
            modes.T @ (self.spring[:, None] * modes) + np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]) * BENDING / SIDE**4
        )
        shape, slopes = _modes(points)
        work: np.ndarray = shape * -forces[:, 2:] + THICK * np.einsum("na,nam->nm", forces[:, :2], slopes)
        moved: np.ndarray = np.linalg.inv(stiffness) @ work.T
        return (modes @ moved).T * self.spring

    def voltages(
        self, points: Float[np.ndarray, "n 3"], forces: Float[np.ndarray, "n 3"], rng: np.random.Generator
    ) -> Float[np.ndarray, "n k"]:
        """Return readings (n, k) [V] without zero: gain, bow, cross-talk and noise of each cell."""
        loads = self.loads(points, forces)
        share = loads / RATING
        bowed = (
            loads
            + 4.0 * RATING * self.bow * share * (1.0 - np.abs(share))
            + forces[:, :2] @ self.crossed.T / len(share.T)
        )
        return self.gain * (bowed + self.noise * RATING * rng.standard_normal(loads.shape))


def _modes(points: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 2 6"]]:
    """Return the displacement by each mode, 1, x, y, x y, x^2 and y^2, at points, and its slopes along x and y."""
    (x, y), one, none = points[:, :2].T, np.ones(len(points)), np.zeros(len(points))
    along, across = (none, one, none, y, 2 * x, none), (none, none, one, x, none, 2 * y)
    return np.stack([one, x, y, x * y, x**2, y**2], axis=1), np.stack([np.stack(along, 1), np.stack(across, 1)], axis=1)


@dataclass(frozen=True, eq=False)
class PlateRun:
    """Touches in turn, each steady for 2 s after 1 s of rest; `touch` is the number of each sample's, -1: none."""

    time: Float[np.ndarray, " n"]
    voltages: Float[np.ndarray, "n k"]
    touch: np.ndarray
    point: Float[np.ndarray, "t 3"]
    force: Float[np.ndarray, "t 3"]


def plate_run(
    plate: Plate, rng: np.random.Generator, force: Float[np.ndarray, " t"], friction: float, shear: float = 0.0
) -> PlateRun:
    """Press with each force [N] in turn at places drawn over the plate.

    Shear is up to `friction` times the force; or of a standard deviation of `shear` times it along x and along y.
    """
    count, up = len(force), np.array([[0.0, 0.0, 1.0]])
    reach = SIDE / 2 - 2 * INSET
    point = np.column_stack([rng.uniform(-reach, reach, (count, 2)), np.zeros(count)])
    slope = np.where(shear > 0, shear * np.sqrt(rng.chisquare(2, count)), friction * np.sqrt(rng.uniform(size=count)))
    pushed = directed_forces(up.repeat(count, 0), force * np.hypot(1.0, slope), slope, rng.uniform(0, 2 * np.pi, count))
    each = round((RESTS + STANDS) * RATE)
    number = np.repeat(np.arange(count), each)
    touch = np.append(np.where(np.arange(len(number)) % each < RESTS * RATE, -1, number), [-1] * round(RESTS * RATE))
    points, forces = np.append(point, [[0, 0, 0]], axis=0)[touch], np.append(pushed, [[0, 0, 0]], axis=0)[touch]
    zero = rng.normal(0.0, 0.02, len(plate.gain))
    return PlateRun(np.arange(len(touch)) / RATE, zero + plate.voltages(points, forces, rng), touch, point, pushed)


def write_plate_session(plate: Plate, rng: np.random.Generator, folder: Path) -> tuple[PlateRun, PlateRun]:
    """Write bench_log.csv of weights and their places, log.csv and truth.csv of touches, plate.stl and rig.toml."""
    import polars
    import trimesh

    folder.mkdir(parents=True, exist_ok=True)
    weights = plate_run(plate, rng, np.repeat([2.0, 5.0, 10.0], 4), 0.0)
    touches = plate_run(plate, rng, rng.uniform(1.0, 10.0, 12), 0.2)
    names = [f"u{cell + 1}" for cell in range(len(plate.gain))]
    place = np.append(weights.point, [[0, 0, 0]], axis=0)[weights.touch, :2]
    weight = -np.append(weights.force, [[0, 0, 0]], axis=0)[weights.touch, 2:]
    for path, run, more, columns in (
        ("bench_log.csv", weights, [weight, place], ["ref_f", "ref_x", "ref_y"]),
        ("log.csv", touches, [], []),
    ):
        rows = np.concatenate([run.time[:, None], run.voltages, *more], axis=1)
        polars.DataFrame(rows, schema=["time", *names, *columns]).write_csv(folder / path)
    start = (RESTS + STANDS) * np.arange(len(touches.force)) + RESTS
    truth = np.column_stack([start, start + STANDS, touches.point, touches.force])
    header = ["start", "end", "px", "py", "pz", "fx", "fy", "fz"]
    polars.DataFrame(truth, schema=header).write_csv(folder / "truth.csv")
    box = trimesh.creation.box((SIDE, SIDE, THICK))
    box.apply_translation((0.0, 0.0, -THICK / 2))
    box.export(folder / "plate.stl")
    columns, positions = str(names).replace("'", '"'), plate.position.round(9).tolist()
    (folder / "rig.toml").write_text(_RIG.format(columns=columns, positions=positions))
    return weights, touches
