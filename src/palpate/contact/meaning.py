"""Name the usual mistake about frame, sign, axes or point of wrenches that do not fit the body as they are taken."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from palpate.contact.estimate import Status
from palpate.contact.locate import Locator
from palpate.spatial.pose import Pose

__all__: list[str] = []  # for this package alone

LOADED = 0.3  # of the 95th percentile of the force: below it noise moves the line
TRIED = 100  # loaded samples, evenly spread
FEWEST = 3  # touches without which nothing is said
FITS = 0.85  # share of samples that a contact explains where the meaning is right
BETTER = 3.0  # how many times fewer samples without an explanation the named meaning must leave
ALIKE = 0.03  # shares that do not differ
FACING = 0.7  # cosine to the direction from the sensor, beyond which a touch is on one of two sides
ONE_SIDED = 0.8  # share of these touches on the side of the sensor
QUARTER = (("x", "z", "-y"), ("x", "-z", "y"), ("z", "y", "-x"), ("-z", "y", "x"), ("y", "-x", "z"), ("-y", "x", "z"))
TURNED = (*QUARTER, ("x", "-y", "-z"), ("-x", "y", "-z"), ("-x", "-y", "z"))
SWAPPED = (("y", "x", "z"), ("z", "y", "x"), ("x", "z", "y"))
MIRRORED = (("-x", "y", "z"), ("x", "-y", "z"), ("x", "y", "-z"))


class Known(NamedTuple):
    """Samples of a log: wrenches as they are taken, and the poses of the sensor.

    Attributes:
        wrench: (n, 6) about and along the sensor's frame [N, N m], force first.
        rotation: (n, 3, 3) of the sensor in the base; None: unknown.
        position: (n, 3) of the sensor in the base [m]; None: unknown.
        frame: along which the log has the force: "sensor" or "base".
    """

    wrench: Float[np.ndarray, "n 6"]
    rotation: Float[np.ndarray, "n 3 3"] | None
    position: Float[np.ndarray, "n 3"] | None
    frame: str


class _Meaning(NamedTuple):
    """Lines for the rig, and the wrenches (n, 6) that they would make."""

    lines: str
    wrench: Float[np.ndarray, "n 6"]


def other_meaning(known: Known, locator: Locator, mount: Pose) -> str:
    """Return a warning that names the lines of the rig by which the wrenches fit the body far better; "": none do.

    Args:
        known: samples in the order of time.
        locator: on the body.
        mount: T_sensor_surface.
    """
    known = _loaded(known)
    if not len(known.wrench):
        return ""
    shares = [_explained(known.wrench, locator, mount).mean()]
    if shares[0] > FITS:
        return ""
    tried = list(_meanings(known, mount.apply(locator.surface.centre)))
    shares += [float(_explained(each.wrench, locator, mount).mean()) for each in tried]
    best = max(shares[1:])
    if best < FITS or BETTER * (1.0 - best) > 1.0 - shares[0]:
        return ""
    alike = [each.lines for each, share in zip(tried, shares[1:], strict=True) if share > best - ALIKE][:3]
    return (
        f"a contact explains {shares[0]:.0%} of the loaded samples as the rig takes them, and {best:.0%} with "
        f"{', or '.join(alike)}: check which of frame, sign, axes, point and orientation the log has"
    )


def reversed_sign(known: Known, locator: Locator, mount: Pose) -> str:
    """Return a warning if the touches press from the sensor's side of the body, where it is held; else "".

    A reaction has the line of the force that caused it, so only the side on which it leaves the body differs.

    Args:
        known: samples in the order of time.
        locator: on the body.
        mount: T_sensor_surface.
    """
    known = _loaded(known)
    if not len(known.wrench):
        return ""
    sides, opposite = (_sides(sign * known.wrench, locator, mount) for sign in (1.0, -1.0))
    decided = np.abs(sides) > FACING
    towards = decided & (sides < 0.0) & (opposite > FACING)
    if np.count_nonzero(towards) < FEWEST or towards.sum() < ONE_SIDED * decided.sum() or decided.mean() < 0.1:
        return ""
    return (
        f"{towards.sum() / decided.sum():.0%} of the touches at the two ends of the body press on the one at the sensor, "
        "which holds it: if nothing touches there, the wrench is what the robot does to the world: "
        'state acts_on = "environment" in [force_torque], or "body" if that is stated'
    )


def _loaded(known: Known) -> Known:
    """Return some of the loaded samples; none where there are too few touches."""
    strength = np.linalg.norm(known.wrench[:, :3], axis=1)
    for values in (known.wrench, known.rotation, known.position):
        if values is not None:
            strength[~np.isfinite(values).reshape(len(values), -1).all(axis=1)] = 0.0
    loaded = strength > 0.0
    loaded &= strength >= LOADED * np.percentile(strength[loaded], 95) if loaded.any() else False
    touches = np.count_nonzero(np.diff(np.concatenate([[False], loaded]).astype(int)) == 1)
    rows = np.flatnonzero(loaded)[:: max(1, int(loaded.sum()) // TRIED)] if touches >= FEWEST else np.arange(0)
    rotation, position = (None if each is None else each[rows] for each in (known.rotation, known.position))
    return Known(known.wrench[rows], rotation, position, known.frame)


def _explained(wrench: Float[np.ndarray, "n 6"], locator: Locator, mount: Pose) -> Bool[np.ndarray, " n"]:
    found = locator.run(wrench @ mount.inverse().wrench_matrix().T, sequential=False)
    return np.asarray(found.status) <= Status.AMBIGUOUS


def _sides(wrench: Float[np.ndarray, "n 6"], locator: Locator, mount: Pose) -> Float[np.ndarray, " n"]:
    """Return the cosine between normals and directions from the sensor (n,); 0 where no contact is."""
    found = locator.run(wrench @ mount.inverse().wrench_matrix().T, sequential=False)
    away = found.point - mount.inverse().translation
    cosine = np.einsum("nk,nk->n", away, found.normal) / np.maximum(np.linalg.norm(away, axis=1), 1e-12)
    return np.where((np.asarray(found.status) <= Status.AMBIGUOUS) & np.isfinite(cosine), cosine, 0.0)


def _meanings(known: Known, centre: Float[np.ndarray, "3"]) -> Iterator[_Meaning]:
    """Yield the usual mistakes, the likelier ones first."""
    framed = [_Meaning("", known.wrench), *_frames(known)]
    yield from framed[1:]
    yield from _orientations(known)
    yield from _axes(known)
    for each in framed:
        point = _point(each.wrench, centre)
        moved = each.wrench.copy()
        moved[:, 3:] += np.cross(point, moved[:, :3])
        numbers = ", ".join(f"{number:.3f}" for number in point)
        yield _Meaning(f"{each.lines}{' and ' * bool(each.lines)}reference about [{numbers}]", moved)


def _frames(known: Known) -> Iterator[_Meaning]:
    if known.rotation is None:
        return
    other = "base" if known.frame == "sensor" else "sensor"
    turned = _turned(known.wrench, known.rotation if other == "sensor" else known.rotation.swapaxes(1, 2))
    force, torque = turned[:, :3], turned[:, 3:]
    yield _Meaning(f'frame = "{other}"', turned)
    yield _Meaning(f'torque_frame = "{other}"', np.hstack([known.wrench[:, :3], torque]))
    yield _Meaning(f'frame = "{other}" and torque_frame = "{known.frame}"', np.hstack([force, known.wrench[:, 3:]]))
    if known.position is None:
        return
    there = np.einsum("nji,nj->ni", known.rotation, known.position)  # along the sensor's axes
    for lines, wrench in (("", known.wrench), (f'frame = "{other}" and ', turned)):
        for point, sign in (("base", -1.0), ("sensor", 1.0)):
            moved = wrench.copy()
            moved[:, 3:] += sign * np.cross(there, moved[:, :3])
            yield _Meaning(f'{lines}reference = "{point}"', moved)


def _orientations(known: Known) -> Iterator[_Meaning]:
    """Yield other forms of the orientation, along which a wrench of the base is turned."""
    if known.frame != "base" or known.rotation is None:
        return
    from scipy.spatial.transform import Rotation  # here: it takes 0.1 s to import

    read = Rotation.from_matrix(known.rotation)
    quaternion, vector = read.as_quat(), read.as_rotvec()
    others = {
        "inverse = true": read.inv(),
        'form = "quaternion_wxyz"': Rotation.from_quat(quaternion[:, [1, 2, 3, 0]]),
        'form = "quaternion"': Rotation.from_quat(quaternion[:, [3, 0, 1, 2]]),
        'form = "euler_xyz"': Rotation.from_euler("xyz", vector),
        'form = "euler_XYZ"': Rotation.from_euler("XYZ", vector),
        'form = "rotation_vector"': Rotation.from_rotvec(read.as_euler("xyz")),
        'form = "euler_XYZ" (moving axes)': Rotation.from_euler("XYZ", read.as_euler("xyz")),
    }
    for lines, other in others.items():
        yield _Meaning(f"{lines} in [orientation]", _turned(known.wrench, (other.inv() * read).as_matrix()))


def _axes(known: Known) -> Iterator[_Meaning]:
    """Yield other axes of force and torque, of one of them, or of both by the rule of the left hand."""
    plain, back = np.eye(3), np.swapaxes
    into = known.rotation if known.frame == "base" and known.rotation is not None else plain[None]
    logged = _turned(known.wrench, into)
    for axes in (*MIRRORED, *SWAPPED, *TURNED):
        matrix, named = _matrix(axes), str(list(axes)).replace("'", '"')
        hand = " and left_handed = true" * (axes not in TURNED)
        same = ' and torque_axes = ["x", "y", "z"]'
        tried = [(f"axes = {named}{hand}", matrix, matrix), (f"torque_axes = {named}", plain, matrix)]
        if axes not in TURNED:
            ruled = str([f"-{axis}".replace("--", "") for axis in axes]).replace("'", '"')
            tried += [(f"axes = {named}{hand}{same}", matrix, plain)]
            tried += [(f"axes = {named}{hand} and torque_axes = {ruled}", matrix, -matrix)]
        for lines, force, torque in tried:
            made = np.hstack([logged[:, :3] @ force.T, logged[:, 3:] @ torque.T])
            yield _Meaning(lines, _turned(made, back(into, 1, 2)))
    reverse = np.hstack([logged[:, :3], -logged[:, 3:]])
    yield _Meaning('torque_axes = ["-x", "-y", "-z"]', _turned(reverse, back(into, 1, 2)))


def _matrix(axes: tuple[str, ...]) -> Float[np.ndarray, "3 3"]:
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
    return -np.linalg.lstsq(across.sum(axis=0), (np.cross(force, torque) / square).sum(axis=0), rcond=1e-6)[0]
