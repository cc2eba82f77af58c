"""Name the usual mistake about frame, sign, axes, point or poses of wrenches that do not fit the body as taken."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import permutations
from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.estimate import Status
from palpate.contact.locate import Locator
from palpate.spatial.pose import Pose
from palpate.surfaces.mesh import UNITS, plausible_size

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

__all__: list[str] = []  # for this package alone

LOADED = 0.3  # of the 95th percentile of the force: below it noise moves the line
TRIED = 50  # loaded samples, evenly spread
FEWEST = 3  # touches without which nothing is said,
TWO = 2  # and those of them on the side of the sensor
DOUBTED = 0.6  # share of samples that a contact explains, above which the meaning is taken as right
FITS = 0.85  # share of samples that a contact explains where the meaning is right
BETTER = 3.0  # how many times fewer samples without an explanation the named meaning must leave
STRAIGHTER, SURE = 2.0, 6.0  # times smaller a mean square, and nats by which another unit of the mesh is named
FEW, NEARLY, NEAR = 6, 1.2, 5.0  # touches, mean squares that do not differ, and times smaller than what is touched
NONE = np.inf, 1.0, ""
ALIKE = 0.03  # shares that do not differ
FACING = 0.7  # cosine to the direction from the sensor, beyond which a touch is on one of two sides
ONE_SIDED = 0.7  # share of the samples that decide, for a reaction
QUARTER = (("x", "z", "-y"), ("x", "-z", "y"), ("z", "y", "-x"), ("-z", "y", "x"), ("y", "-x", "z"), ("-y", "x", "z"))
TURNED = (*QUARTER, ("x", "-y", "-z"), ("-x", "y", "-z"), ("-x", "-y", "z"))
SWAPPED = (("y", "x", "z"), ("z", "y", "x"), ("x", "z", "y"))
FORMS = {  # numbers of an orientation -> its forms
    3: ("rotation_vector", "euler_xyz", "euler_zyx", "euler_XYZ", "euler_ZYX"),
    4: ("quaternion_wxyz", "quaternion"),
}
PLAIN = ("x", "y", "z")
Rotations = Float[np.ndarray, "n 3 3"]
MIRRORED = (("-x", "y", "z"), ("x", "-y", "z"), ("x", "y", "-z"))


class Known(NamedTuple):
    """Samples of a log: wrenches as they are taken, the poses of the sensor, and what the rig states.

    Attributes:
        wrench: (n, 6) about and along the sensor's frame [N, N m], force first.
        rotation: (n, 3, 3) of the sensor in the base; None: unknown.
        position: (n, 3) of the sensor in the base [m]; None: unknown.
        frame: along which the log has the force: "sensor" or "base".
        reference: point of the logged torque: "sensor", "base", or a point (3,) [m] in the sensor's frame.
        acts_on: "body" or "environment".
        axes, torque_axes: logged axes that are the sensor's x, y, z, of the force and of the torque.
        form: of the orientation, as in a rig.
    """

    wrench: Float[np.ndarray, "n 6"]
    rotation: Float[np.ndarray, "n 3 3"] | None
    position: Float[np.ndarray, "n 3"] | None
    frame: str = "sensor"
    reference: str | tuple[float, ...] = "sensor"
    acts_on: str = "body"
    axes: Sequence[str] = PLAIN
    torque_axes: Sequence[str] = PLAIN
    form: str = "quaternion"

    def shift(self, reference: str | tuple[float, ...], rotation: Rotations | None = None) -> Float[np.ndarray, "n 3"]:
        """Return the point (n, 3) [m] in the sensor's frame, whose rotations may be others than those known."""
        if reference != "base" or self.position is None or self.rotation is None:
            return np.tile(np.zeros(3) if isinstance(reference, str) else reference, (len(self.wrench), 1))
        return -np.einsum("nji,nj->ni", self.rotation if rotation is None else rotation, self.position)


class _Meaning(NamedTuple):
    """Lines for the rig, and the wrenches (..., n, 6) that they would make; one of several is enough."""

    lines: str
    wrench: Float[np.ndarray, "*several n 6"]


def other_meaning(known: Known, locator: Locator, mount: Pose) -> str:
    """Return a warning that names the lines of the rig by which the wrenches fit the body far better; "": none do.

    Args:
        known: samples in the order of time.
        locator: on the body.
        mount: T_sensor_surface.
    """
    known, _ = _loaded(known)
    if not len(known.wrench):
        return ""
    share = _share(known.wrench, locator, mount)
    if share > DOUBTED:
        return ""
    raw = _moved(known.wrench, -known.shift(known.reference))
    frames = list(_frames(known, raw))
    tried = [*_points(known, frames), *_orientations(known, raw), *_axes(known, raw)]
    centre, size = mount.apply(locator.surface.centre), locator.surface.size
    for each in (tried, _fitted(frames, centre)):
        hits = [meaning for meaning in each if _near(meaning.wrench, centre, size) >= FITS]
        fits = [(meaning.lines, _share(meaning.wrench, locator, mount)) for meaning in hits]
        if not fits:
            continue
        best = max(fit for _, fit in fits)
        if best >= FITS and BETTER * (1.0 - best) <= 1.0 - share:
            alike = [lines for lines, fit in fits if fit > best - ALIKE]
            more = f", and as well with {len(alike) - 3} more" if len(alike) > 3 else ""
            return (
                f"a contact explains {share:.0%} of the loaded samples as the rig takes them, and {best:.0%} with "
                f"{', or '.join(alike[:3])}{more}: if that is what the log has, state it in the rig"
            )
    return ""


def smaller_body(known: Known, locator: Locator, mount: Pose) -> str:
    """Return a warning if forces fit the body as well or far better were its mesh in a smaller unit; else "".

    Lines of force that meet a small body meet one many times larger, too: near its origin, and askew if it is round.

    Args:
        known: samples in the order of time.
        locator: on the body.
        mount: T_sensor_surface.
    """
    known, touch = _loaded(known)
    touches, size = len(np.unique(touch)), locator.surface.size
    slope = _slope(known.wrench, locator, mount) if touches else np.inf
    if not np.isfinite(slope):
        return ""
    found: list[tuple[float, float, str]] = []
    for larger, smaller in permutations(UNITS, 2):
        times = UNITS[larger] / UNITS[smaller]
        if times < 2.0 or not plausible_size(size / times):
            continue
        if _near(known.wrench, mount.apply(locator.surface.centre / times), size / times) >= FITS:
            found.append((_slope(known.wrench, locator, mount, times), times, f"{smaller} where {larger} is stated"))
    least = min(found, default=(np.inf,))[0]
    best, times, units = max((each for each in found if each[0] <= NEARLY * least), key=itemgetter(1), default=NONE)
    if best > NEARLY * slope or touches < FEW:
        return ""
    unit = f"were it {times:.3g} times smaller, as in {units}: check the mesh's unit (unit in [surface])"
    if slope < STRAIGHTER * best or touches * np.log(slope / best) < SURE:
        if times < NEAR:
            return ""
        return f"all touches are where they would meet the mesh as well {unit}, unless all were near its origin"
    lean = [np.degrees(np.arctan(np.sqrt(each))) for each in (slope, best)]
    return f"the forces lean {lean[0]:.0f} degrees (rms) from the normals of the mesh, and {lean[1]:.0f} {unit}"


def reversed_sign(known: Known, locator: Locator, mount: Pose) -> str:
    """Return a warning if touches press from the sensor's side of the body, where it is held, or pull; else "".

    A reaction has the line of the force that caused it, so only the side on which it leaves the body differs: that may
    be the one that is held, or one that the force meets beyond the bound of friction.

    Args:
        known: samples in the order of time.
        locator: on the body.
        mount: T_sensor_surface.
    """
    known, touch = _loaded(known)
    if not len(known.wrench):
        return ""
    sides, opposite = (_sides(sign * known.wrench, locator, mount) for sign in (1.0, -1.0))
    stated = (sides > FACING) | (np.isfinite(sides) & np.isnan(opposite))
    reversed_ = ((sides < -FACING) & (opposite > 0.0)) | (np.isfinite(opposite) & np.isnan(sides))
    if len(np.unique(touch[reversed_])) < TWO or reversed_.sum() < ONE_SIDED * (stated | reversed_).sum():
        return ""
    meant = ("environment", "robot does to the world") if known.acts_on == "body" else ("body", "world does to it")
    return (
        f"{reversed_.sum() / len(touch):.0%} of the loaded samples press on the end of the body at the sensor, which "
        "holds it, or only their reaction fits the body: if nothing touches there, the wrench is what the "
        f'{meant[1]}: state acts_on = "{meant[0]}" in [force_torque]'
    )


def _loaded(known: Known) -> tuple[Known, Int[np.ndarray, " n"]]:
    """Return some of the loaded samples, none where there are too few touches, and the number of the touch of each."""
    strength = np.linalg.norm(known.wrench[:, :3], axis=1)
    for values in (known.wrench, known.rotation, known.position):
        if values is not None:
            strength[~np.isfinite(values).reshape(len(values), -1).all(axis=1)] = 0.0
    loaded = strength > 0.0
    loaded &= strength >= LOADED * np.percentile(strength[loaded], 95) if loaded.any() else False
    touch = np.cumsum(np.diff(np.concatenate([[False], loaded]).astype(int)) == 1)
    some = len(touch) and touch[-1] >= FEWEST
    rows = np.flatnonzero(loaded)[:: max(1, int(loaded.sum()) // TRIED)] if some else np.arange(0)
    rotation, position = (None if each is None else each[rows] for each in (known.rotation, known.position))
    return known._replace(wrench=known.wrench[rows], rotation=rotation, position=position), touch[rows]


def _near(wrench: Float[np.ndarray, "*several n 6"], centre: Float[np.ndarray, "3"], size: float) -> float:
    """Return the share of the samples whose line of force passes the ball about a body: the others need no search."""
    force, torque = wrench[..., :3], wrench[..., 3:]
    away = np.linalg.norm(np.cross(force, torque - np.cross(centre, force)), axis=-1) / (force**2).sum(axis=-1)
    return float((away < 0.55 * size).reshape(-1, wrench.shape[-2]).any(axis=0).mean())


def _share(wrench: Float[np.ndarray, "*several n 6"], locator: Locator, mount: Pose) -> float:
    """Return the share of the samples that a contact explains, at least one of several wrenches each."""
    found = locator.run(wrench.reshape(-1, 6) @ mount.inverse().wrench_matrix().T, sequential=False)
    explained = (np.asarray(found.status) <= Status.AMBIGUOUS).reshape(-1, wrench.shape[-2])
    return float(explained.any(axis=0).mean())


def _slope(wrench: Float[np.ndarray, "n 6"], locator: Locator, mount: Pose, times: float = 1.0) -> float:
    """Return the mean square of tan(angle between -force and normal) on a body so many times smaller; inf: no fit."""
    scale = np.array([1.0, 1.0, 1.0, times, times, times])  # a larger torque is a smaller body
    noise = None if locator.noise is None else locator.noise * np.outer(scale, scale)
    other = Locator(locator.surface, locator.method, locator.friction, times * locator.torsion, noise)
    found = other.run(wrench @ mount.inverse().wrench_matrix().T * scale, sequential=False)
    fits = np.asarray(found.status) <= Status.AMBIGUOUS
    force, normal = found.force[fits], found.normal[fits]
    if fits.mean() < FITS:
        return np.inf
    ratio: Float[np.ndarray, " k"] = (force**2).sum(axis=1) / np.maximum((force * normal).sum(axis=1) ** 2, 1e-300)
    return float(ratio.mean()) - 1.0


def _sides(wrench: Float[np.ndarray, "n 6"], locator: Locator, mount: Pose) -> Float[np.ndarray, " n"]:
    """Return the cosine between normals and directions from the sensor (n,); NaN where there is no contact."""
    found = locator.run(wrench @ mount.inverse().wrench_matrix().T, sequential=False)
    away = found.point - mount.inverse().translation
    cosine = np.einsum("nk,nk->n", away, found.normal) / np.maximum(np.linalg.norm(away, axis=1), 1e-12)
    return np.where((np.asarray(found.status) <= Status.AMBIGUOUS) & np.isfinite(cosine), cosine, np.nan)


def _frames(known: Known, raw: Float[np.ndarray, "n 6"]) -> Iterator[_Meaning]:
    """Yield the logged wrench along the sensor's axes, by each frame that force and torque may have."""
    yield _Meaning("", raw)
    if known.rotation is None:
        return
    other = "base" if known.frame == "sensor" else "sensor"
    turned = _turned(raw, known.rotation if other == "sensor" else known.rotation.swapaxes(1, 2))
    yield _Meaning(f'frame = "{other}"', turned)
    yield _Meaning(f'torque_frame = "{other}"', np.hstack([raw[:, :3], turned[:, 3:]]))
    lines = f'frame = "{other}" and torque_frame = "{known.frame}"'
    yield _Meaning(lines, np.hstack([turned[:, :3], raw[:, 3:]]))


def _points(known: Known, frames: Sequence[_Meaning]) -> Iterator[_Meaning]:
    """Yield wrenches of each frame about the points that can be named, but for what the rig states."""
    posed = known.position is not None and known.rotation is not None
    others = [name for name in ("sensor", "base") if name != known.reference and (posed or name == "sensor")]
    for each in frames:
        if each.lines:
            yield _Meaning(each.lines, _moved(each.wrench, known.shift(known.reference)))
    for each in frames:
        for name in others:
            lines = " and ".join(filter(None, (each.lines, f'reference = "{name}"')))
            yield _Meaning(lines, _moved(each.wrench, known.shift(name)))


def _fitted(frames: Sequence[_Meaning], centre: Float[np.ndarray, "3"]) -> Iterator[_Meaning]:
    """Yield wrenches of each frame about the point by which they fit the body best."""
    for each in frames:
        point = _point(each.wrench, centre)
        numbers = ", ".join(f"{number + 0.0:.3f}" for number in point)
        lines = " and ".join(filter(None, (each.lines, f"reference = about [{numbers}], such as a flange or a TCP")))
        yield _Meaning(lines, _moved(each.wrench, point))


def _orientations(known: Known, raw: Float[np.ndarray, "n 6"]) -> Iterator[_Meaning]:
    """Yield other forms of the orientation, along which a wrench of the base is turned."""
    if "base" not in (known.frame, known.reference) or known.rotation is None:
        return
    from scipy.spatial.transform import Rotation  # here: it takes 0.1 s to import

    read = Rotation.from_matrix(known.rotation)
    others = {"inverse = true": [read.inv()]}
    for form in FORMS.get(_numbers(known.form), ()):
        if known.form.removesuffix("_deg") != form:
            unit = "_deg" * (known.form.endswith("_deg") and form.startswith("euler"))
            others[f'form = "{form}{unit}"'] = [_rotation(form, each) for each in _recorded(known.form, read)]
    for lines, rotations in others.items():
        made = [(other.as_matrix(), (other.inv() * read).as_matrix()) for other in rotations]
        turned = [
            _moved(_turned(raw, back) if known.frame == "base" else raw, known.shift(known.reference, there))
            for there, back in made
        ]
        yield _Meaning(f"{lines} in [orientation]", np.array(turned))


def _numbers(form: str) -> int:
    return 4 if form.startswith("quaternion") else 9 if form.startswith("matrix") else 3


def _recorded(form: str, read: Rotation) -> list[Float[np.ndarray, "n k"]]:
    """Return the numbers from which rotations may have been read, in rad: angles have more than one form."""
    if form.startswith("quaternion"):
        return [read.as_quat()[:, [3, 0, 1, 2] if form.endswith("wxyz") else [0, 1, 2, 3]]]
    if form == "rotation_vector":
        vector = read.as_rotvec()
        angle = np.linalg.norm(vector, axis=1, keepdims=True)
        return [vector, vector * (1.0 - 2.0 * np.pi / np.maximum(angle, 1e-9))]
    axes: Any = form.split("_")[1]
    angles: Float[np.ndarray, "n 3"] = read.as_euler(axes)
    return [angles, np.array([np.pi, np.pi, np.pi]) + angles * [1.0, -1.0, 1.0]]


def _rotation(form: str, numbers: Float[np.ndarray, "n k"]) -> Rotation:
    from scipy.spatial.transform import Rotation

    if form.startswith("quaternion"):
        return Rotation.from_quat(numbers[:, [1, 2, 3, 0] if form.endswith("wxyz") else [0, 1, 2, 3]])
    return Rotation.from_rotvec(numbers) if form == "rotation_vector" else Rotation.from_euler(form[6:], numbers)


def _axes(known: Known, raw: Float[np.ndarray, "n 6"]) -> Iterator[_Meaning]:
    """Yield other axes of force and torque, of one of them, or of both by the rule of the left hand."""
    plain, shift = np.eye(3), known.shift(known.reference)
    into = known.rotation if known.frame == "base" and known.rotation is not None else plain[None]
    logged = _turned(raw, into)
    tried = [(plain, -plain)]
    for axes in (*MIRRORED, *SWAPPED, *TURNED):
        matrix = _matrix(axes)
        tried += [(matrix, matrix), (plain, matrix)]
        tried += [] if axes in TURNED else [(matrix, plain), (matrix, -matrix)]
    for force, torque in tried:
        made = np.hstack([logged[:, :3] @ force.T, logged[:, 3:] @ torque.T])
        lines = _lines(force @ _matrix(known.axes), torque @ _matrix(known.torque_axes))
        yield _Meaning(lines, _moved(_turned(made, into.swapaxes(1, 2)), shift))


def _lines(force: Float[np.ndarray, "3 3"], torque: Float[np.ndarray, "3 3"]) -> str:
    """Return the keys of a rig for the axes of force and torque."""
    hand = ", left_handed = true" if np.linalg.det(force) < 0 else ""
    other = "" if np.array_equal(force, torque) else f", torque_axes = {_named(torque)}"
    return f"axes = {_named(force)}{hand}{other}"


def _named(matrix: Float[np.ndarray, "3 3"]) -> str:
    names = [f'"{"-" if row.sum() < 0 else ""}{"xyz"[np.argmax(np.abs(row))]}"' for row in matrix]
    return f"[{', '.join(names)}]"


def _moved(wrench: Float[np.ndarray, "n 6"], point: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "n 6"]:
    """Return wrenches about the origin, whose torque was about a point [m]."""
    return np.hstack([wrench[:, :3], wrench[:, 3:] + np.cross(point, wrench[:, :3])])


def _matrix(axes: Sequence[str]) -> Float[np.ndarray, "3 3"]:
    matrix = np.zeros((3, 3))
    for row, axis in enumerate(axes):
        matrix[row, "xyz".index(axis[-1])] = -1.0 if axis[0] == "-" else 1.0
    return matrix


def _turned(wrench: Float[np.ndarray, "n 6"], rotation: Float[np.ndarray, "#n 3 3"]) -> Float[np.ndarray, "n 6"]:
    parts = wrench.reshape(-1, 2, 3)
    return np.einsum("nij,nkj->nki", np.broadcast_to(rotation, (len(wrench), 3, 3)), parts).reshape(-1, 6)


def _point(wrench: Float[np.ndarray, "n 6"], centre: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Return the reference point (3,) [m] about which the lines of the forces pass nearest to the middle of the body.

    The line of (F, M + c x F) passes the middle m at F x (M - m x F) / F^2 + (I - f f^T) c, with f = F / |F|.
    """
    force, torque = wrench[:, :3], wrench[:, 3:] - np.cross(centre, wrench[:, :3])
    square = np.einsum("nk,nk->n", force, force)[:, None]
    across = np.eye(3) - np.einsum("ni,nj->nij", force, force) / square[:, :, None]
    sides: Float[np.ndarray, "3"] = (np.cross(force, torque) / square).sum(axis=0)
    return -np.asarray(np.linalg.lstsq(across.sum(axis=0), sides, rcond=1e-6)[0], dtype=np.float64)
