"""Skins whose taxels measure three axes: force with its shear, place, torque and certainty, on two kinds of mechanics.

The lab (`palpate_lab.simulation.three_axis_skins`) presses magnets in rubber over Hall sensors, and elastic pillars, of
16 and 24 taxels: gains differ by 5 %, axes by 2 degrees, 1.5 % of each neighbour is in a reading, 2.5 % follows late,
and the body turns in the earth's field. Each unit is calibrated by presses with three tips, and tested with three
others, of which two at once are small enough to have room: 0.5 to 10 N, shear up to 0.8 of the normal force in all
directions, at random places up to the outer taxels. The frame in the middle of each touch is judged. The truth of
pillars is the resultant on them and its centre.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from time import process_time
from unittest import mock

import numpy as np

from claims.row import Row
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import CHI2_95
from palpate.contact.ground_truth import TrueSamples
from palpate.sensors.fused.locator import FusedLocator, FusionSettings
from palpate.sensors.taxels import calibrate_response
from palpate.sensors.taxels.calibrate_response import identify_response
from palpate.sensors.taxels.estimator import TaxelEstimator
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.response import TaxelResponse
from palpate.signals.recording import CELLS, TEMPERATURE, Recording
from palpate.surfaces.mesh import plane
from palpate_lab.simulation.three_axis_skins import ThreeAxisSkin, magnetic_skin, pillar_array
from palpate_lab.simulation.three_axis_touches import RATE, SMALL_TIPS, UNSEEN_TIPS, Loads, three_axis_touches

SKINS: dict[str, Callable[[int, int, int], ThreeAxisSkin]] = {"magnets": magnetic_skin, "pillars": pillar_array}
SIZES = ((4, 4), (4, 6))
CHI2_95_OF_3 = 7.814727903251179  # 95 % point of chi-square with three degrees of freedom
ROOM, THERMOMETER = 25.0, 0.05  # degrees C; K: deviation of a thermometer in the skin
SHEARED = 0.2  # of the normal force, from which a direction of the shear is judged
_FORCE = [f"force_{name}" for name in ("xx", "xy", "xz", "xy", "yy", "yz", "xz", "yz", "zz")]


@dataclass
class Errors:
    """What was found of n true contacts that were found, a value each.

    Attributes:
        normal, shear: errors as shares of the normal force, and of the force.
        turn: error of the direction of the shear [degrees]; NaN where there is little.
        place: error of the place [pitches].
        inside, forces: whether the 95 % ellipses of place and force contain the truth.
        torque: error of the torque about the normal, and the torque [N m].
    """

    normal: np.ndarray
    shear: np.ndarray
    turn: np.ndarray
    place: np.ndarray
    inside: np.ndarray
    forces: np.ndarray
    torque: np.ndarray


def rows(small: bool) -> Iterator[Row]:
    """Force, place, certainty, torque and two touches of each kind and size of skin."""
    units, presses, touches = (1, 44, 25) if small else (12, 240, 150)  # touches of a unit share its calibration
    with few_folds(small):
        for name, make in SKINS.items():
            for size in SIZES[: 1 if small else None]:
                skins = [make(*size, unit) for unit in range(units)]
                of = f"{units} skins of {size[0] * size[1]} {name}, {touches} touches each"
                trained = [(skin, calibrated(skin, presses, 10 + unit)) for unit, skin in enumerate(skins)]
                yield from _single(of, trained, touches, small)
                yield from _twisted(of, trained, touches)
                yield _pairs(of, trained, touches, small)
        yield _fused(presses, touches, small)
    yield _fast(small)


@contextmanager
def few_folds(few: bool) -> Iterator[None]:
    """Calibrate with a third of the presses left out at a time: half of the processor."""
    with mock.patch.object(calibrate_response, "FOLDS", 3 if few else calibrate_response.FOLDS):
        yield


def calibrated(
    skin: ThreeAxisSkin, presses: int, seed: int, swings: float = 0.0, known: bool = False
) -> TaxelEstimator:
    """Return the estimator of a skin, calibrated by presses with known forces at known places.

    The temperature `swings` by so many kelvin up and down once meanwhile, which a thermometer measures if `known`.
    """
    loads = three_axis_touches(skin.positions, np.random.default_rng(seed), presses)
    recording, truth = _recorded(skin, loads, seed, swings * np.sin(np.linspace(0, 2 * np.pi, loads.count)), known)
    body = TaxelBody.anywhere(skin.positions, skin.normals, along=(1.0, 0.0, 0.0))
    press = TrueSamples(truth.frame / RATE, truth.place, None, truth.force)
    return TaxelEstimator(replace(body, response=identify_response(body, recording, press)))


def _recorded(skin: ThreeAxisSkin, loads: Loads, seed: int, warmer: np.ndarray, known: bool) -> tuple[Recording, Loads]:
    readings, truth = skin.readings(loads, seed, warmer)
    channels, scatter = {CELLS: readings}, np.random.default_rng(seed + 1).standard_normal(len(readings))
    if known:
        channels[TEMPERATURE] = np.round(ROOM + warmer + THERMOMETER * scatter, 2)[:, None]
    return Recording(np.arange(len(readings)) / RATE, channels), truth


def trials(
    trained: list[tuple[ThreeAxisSkin, TaxelEstimator]],
    touches: int,
    seed: int,
    pairs: bool = False,
    twist: bool = False,
    warms: float = 0.0,
    known: bool = False,
) -> Iterator[tuple[ThreeAxisSkin, Contacts, Loads, list[np.ndarray]]]:
    """Yield each skin, the contacts found, the truth, and for each touch its contacts (rows) in the middle frame.

    The skin `warms` evenly by so many kelvin from the first frame to the last.
    """
    for unit, (skin, estimator) in enumerate(trained):
        spacing = (2 * skin.pitch, 3 * skin.pitch) if pairs else None
        options = {"tips": SMALL_TIPS if pairs else UNSEEN_TIPS, "spacing": spacing, "twist": twist}
        loads = three_axis_touches(skin.positions, np.random.default_rng(seed + unit), touches, **options)
        recording, truth = _recorded(skin, loads, seed + unit, warms * np.linspace(0, 1, loads.count), known)
        full = [np.flatnonzero((truth.touch == touch) & truth.full) for touch in range(touches)]
        middle = [each[truth.frame[each] == truth.frame[each[len(each) // 2]]] for each in full]
        yield skin, estimator.run(recording), truth, middle


def errors_of(tested: Iterator[tuple[ThreeAxisSkin, Contacts, Loads, list[np.ndarray]]]) -> tuple[Errors, int, int]:
    """Return the errors of the nearest contacts, how many touches were not found as one, and how many there are."""
    parts, wrong, count = list[Errors](), 0, 0
    for skin, found, truth, middle in tested:
        for (each,) in middle:
            there = np.flatnonzero((found.sample == truth.frame[each]) & found.located)
            wrong, count = wrong + (len(there) != 1), count + 1
            if len(there):
                far = np.linalg.norm(found.point[there] - truth.place[each], axis=1)
                parts.append(_error(found, int(there[far.argmin()]), truth, int(each), skin.pitch))
    made = {field.name: np.array([getattr(part, field.name) for part in parts]) for field in fields(Errors)}
    return Errors(**made), wrong, count


def _error(found: Contacts, row: int, truth: Loads, each: int, pitch: float) -> Errors:
    off, miss = found.point[row] - truth.place[each], found.force[row] - truth.force[each]
    true, felt = truth.force[each], found.force[row]
    cosine = true[:2] @ felt[:2] / (np.linalg.norm(true[:2]) * np.linalg.norm(felt[:2]) + 1e-300)
    sheared = np.linalg.norm(true[:2]) > SHEARED * abs(true[2])
    spread = np.array([found.features[name][row] for name in _FORCE]).reshape(3, 3)
    return Errors(
        normal=abs(miss[2] / true[2]),
        shear=np.linalg.norm(miss[:2]) / np.linalg.norm(true),
        turn=np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))) if sheared else np.nan,
        place=np.linalg.norm(off[:2]) / pitch,
        inside=off @ np.linalg.pinv(found.covariance[row], rcond=1e-6, hermitian=True) @ off <= CHI2_95,
        forces=miss @ np.linalg.solve(spread, miss) <= CHI2_95_OF_3,
        torque=np.array([found.torque[row] - truth.torque[each], truth.torque[each]]),
    )


def _single(of: str, trained: list[tuple[ThreeAxisSkin, TaxelEstimator]], touches: int, small: bool) -> Iterator[Row]:
    errors, wrong, count = errors_of(trials(trained, touches, 100))
    for what, values, limit, unit in (
        ("normal force", 100 * errors.normal, 5.0, " %"),
        ("shear, share of the force", 100 * errors.shear, 8.0, " %"),
        ("direction of the shear", errors.turn, 5.0, " degrees"),
        ("place", errors.place, 0.15, " pitches"),
    ):
        median, most = np.nanmedian(values), np.nanpercentile(values, 95)
        got = f"{median:.2g}{unit} median, {most:.2g}{unit} 95 %"
        met = bool(median <= (2.0 if small else 1.0) * limit)  # small: of a quarter of the presses
        yield Row(f"{what}, {of}", f"<= {limit:g}{unit} median", got, met)
    for what, inside in (("place", errors.inside), ("force", errors.forces)):
        share = float(np.mean(inside))
        met = None if small else 0.93 <= share <= 0.97
        yield Row(f"truth in the 95 % ellipse of the {what}, {of}", "93-97 %", f"{share:.1%} of {len(inside)}", met)
    yield Row(f"touches not found as one, {of}", "", f"{wrong} of {count}")


def _twisted(of: str, trained: list[tuple[ThreeAxisSkin, TaxelEstimator]], touches: int) -> Iterator[Row]:
    errors, _, _ = errors_of(trials(trained, touches, 200, twist=True))
    off, true = 1e3 * np.abs(errors.torque).T
    got = f"{np.median(off):.2g} N mm median, {np.percentile(off, 95):.2g} 95 %; the torques are {np.median(true):.2g}"
    yield Row(f"torque about the normal, twisted, {of}", "", f"{got}, up to {true.max():.2g}")


def _pairs(of: str, trained: list[tuple[ThreeAxisSkin, TaxelEstimator]], touches: int, small: bool) -> Row:
    """Two touches count as found where there are two contacts, each within a pitch of another one."""
    found_both, uneven = list[bool](), list[float]()
    for skin, found, truth, middle in trials(trained, touches, 300, pairs=True):
        for pair in middle:
            there = np.flatnonzero((found.sample == truth.frame[pair[0]]) & found.located)
            far = np.linalg.norm(found.point[there][:, None] - truth.place[pair], axis=2)
            near = far.argmin(axis=1)
            found_both.append(len(there) == 2 and near[0] != near[1] and bool((far.min(axis=1) < skin.pitch).all()))
            uneven.append(abs(float(np.log(truth.force[pair[0], 2] / truth.force[pair[1], 2]))))
    both, alike = np.array(found_both), np.array(uneven) < np.log(3.0)
    share, of_alike = both.mean(), f"{both[alike].mean():.1%} of the {alike.sum()}"
    got = f"{share:.1%} of {len(both)}; {of_alike} whose forces differ less than 3-fold"
    return Row(
        f"two touches with 2 to 3 pitches between them found as two, {of}",
        ">= 95 %",
        got,
        None if small else share >= 0.95,
    )


def _fused(presses: int, touches: int, small: bool) -> Row:
    """Three touches at once on one skin, felt by a wrench below it: with the skin's shear, and without."""
    skin = pillar_array(*((5, 6) if small else (8, 10)), 0)
    estimator = calibrated(skin, presses, 10)
    drawn = [
        three_axis_touches(skin.positions, np.random.default_rng(400 + k), touches, tips=UNSEEN_TIPS) for k in range(3)
    ]
    joined = {each.name: np.concatenate([getattr(one, each.name) for one in drawn]) for each in fields(Loads)[1:]}
    recording, truth = _recorded(skin, Loads(drawn[0].count, **joined), 400, np.zeros(drawn[0].count), False)
    found, rng = estimator.run(recording), np.random.default_rng(401)
    locator = FusedLocator(plane([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], 0.1), FusionSettings(friction=1.2))
    noise, errors = np.repeat([0.05, 0.002], 3), list[np.ndarray]()
    for touch in range(touches):
        full = np.flatnonzero((truth.touch == touch) & truth.full)
        three = full[truth.frame[full] == truth.frame[full[len(full) // 2]]]
        there = np.flatnonzero((found.sample == truth.frame[three[0]]) & found.located)
        far = np.linalg.norm(found.point[there][:, None] - truth.place[three], axis=2)
        if len(there) != 3 or set(far.argmin(axis=1)) != {0, 1, 2}:
            continue
        true, place = truth.force[three[far.argmin(axis=1)]], truth.place[three]
        moment = np.cross(place, truth.force[three]).sum(axis=0) + truth.torque[three].sum() * np.array([0.0, 0.0, 1.0])
        wrench = np.concatenate([true.sum(axis=0), moment]) + noise * rng.standard_normal(6)
        normal, spread = -found.force[there, 2], np.array([found.features[name][there] for name in _FORCE]).T
        skin_feels = (found.point[there], found.normal[there], normal, np.sqrt(spread[:, 8]), found.covariance[there])
        shear = np.column_stack([found.force[there] * [1, 1, 0], 2.0 / (spread[:, 0] + spread[:, 4])])
        both = [locator.fuse(*skin_feels, wrench[None], np.diag(noise**2)[None], shear=each) for each in (None, shear)]
        errors.append(np.array([np.linalg.norm(each.force - true, axis=1).mean() for each in both]))
    one, three_axes = np.median(errors, axis=0)
    got = f"{three_axes:.3g} N, {one:.3g} N without shear, median of {len(errors)}"
    what = f"force of three touches at once, with the wrench below {len(skin.positions)} pillars"
    met = None if small else bool(three_axes <= 0.5 * one)  # few presses do not show all gains
    return Row(what, "<= half of that of one axis", got, met)


def _fast(small: bool) -> Row:
    """Frames a second of CPU time of a large skin, touched in three places or not."""
    row, column = np.indices((40, 60)).reshape(2, -1)
    places, pitch = 5e-3 * np.column_stack([column, row, 0 * row]), 5e-3
    body = TaxelBody.anywhere(places, np.tile([0.0, 0.0, 1.0], (len(places), 1)), along=(1.0, 0.0, 0.0))
    response, rng, count = TaxelResponse.guessed(len(places), pitch), np.random.default_rng(9), 100 if small else 600
    cells = 0.002 * rng.standard_normal((count, len(places), 3))
    for place in ((10.2, 9.1), (30.4, 20.7), (50.3, 30.8)):
        far = places[:, :2] / pitch - place
        cells[count // 3 :] += response.spread_of(far, np.tile([0.5, 0.3, 3.0], (len(far), 1)), np.zeros(len(far)))
    estimator, recording = (
        TaxelEstimator(replace(body, response=response)),
        Recording(np.arange(count) / 100, {CELLS: cells}),
    )
    estimator.run(recording)
    begin = process_time()
    estimator.run(recording)
    rate = count / (process_time() - begin)
    return Row(
        "2,400 taxels of three axes, three touches", ">= 500 frames/s", f"{rate:,.0f}", None if small else rate >= 500
    )
