"""The trials: long contacts, touches that must not be eaten, jumps, and a payload that is wrong."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from claims.papers.drift.follow import Followed, exponential, follow, one_tare
from claims.papers.drift.world import NOISE, RATE, Touch, drift_of, readings, wrenches
from palpate.signals.payload import Payload
from palpate.spatial.pose import rotation_from_quaternion
from palpate_lab.simulation.drift import simulate_drift

FLOOR = 21.65  # sqrt(60 * 7.815): times the walk, 95 % of the zeros are nearer than that after 60 s
FREE, CONTACT, CONTACTS = 300.0, 60.0, 4  # s, s, of a session
CHI2_95 = 7.815  # three degrees
AT = 15.0  # s, of a jump
MINUTE = 1.0 / 60.0  # N/s, of a warm-up of 1 N/min
WALK = 3.5e-3  # N/sqrt(s), where it is not varied


class Line(NamedTuple):
    """A figure: of what, and how much."""

    what: str
    figures: dict[str, float]

    @property
    def got(self) -> str:
        return ", ".join(f"{name} {value:.3g}" for name, value in self.figures.items())


def _session(walk: float, warm_up: float, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Five minutes free, then contacts of 10 N for a minute, each followed by a minute: time, zero, readings, ends."""
    begins = FREE + 2 * CONTACT * np.arange(CONTACTS)
    time = np.arange(0.0, begins[-1] + 2 * CONTACT, 1.0 / RATE)
    zero = simulate_drift(time, drift_of(walk, warm_up), rng)
    held = [Touch(float(begin), float(begin) + CONTACT, 10.0, 0.3, 0.3) for begin in begins]
    return time, zero, readings(time, zero, held, rng), begins


def _off(found: Followed, time: np.ndarray, zero: np.ndarray) -> np.ndarray:
    """(n, 3) by which the zero's force is off in each window."""
    return (found.zero - zero[np.minimum(np.searchsorted(time, found.time), len(time) - 1)])[:, :3]


def long_contacts(walk: float, warm_up: float, sessions: int) -> Line:
    """Errors at the end of 60 s of contact at 10 N: 95 % point of their length [N]; coverage of the 95 % ellipsoid."""
    errors: dict[str, list[float]] = {name: [] for name in ("palpate", "one tare", "gated", "ungated")}
    inside = list[bool]()
    for number in range(sessions):
        time, zero, seen, begins = _session(walk, warm_up, np.random.default_rng([0, number]))
        found = follow(time, seen, drift_of(walk, warm_up))
        at = np.searchsorted(found.time, begins + CONTACT - 0.5)
        truth = zero[np.searchsorted(time, found.time[at])]
        zeros = {
            "palpate": found.zero[at],
            "one tare": one_tare(time, seen, found.time[at]),
            "gated": exponential(time, seen, found.time[at], True),
            "ungated": exponential(time, seen, found.time[at], False),
        }
        for name, each in zeros.items():
            errors[name] += np.linalg.norm((each - truth)[:, :3], axis=1).tolist()
        off = (found.zero[at] - truth)[:, :3]
        whitened: np.ndarray = np.linalg.solve(found.covariance[at][:, :3, :3], off[..., None])[..., 0]
        square: np.ndarray = np.sum(off * whitened, axis=1)
        inside += (square <= CHI2_95).tolist()
    figures = {name: float(np.percentile(each, 95)) for name, each in errors.items()}
    name = f"60 s at 10 N, walk {1e3 * walk:.2g} mN/sqrt(s), warm-up {60 * warm_up:.2g} N/min, {len(inside)} contacts"
    over = figures["palpate"] / (FLOOR * walk)
    return Line(name, {**figures, "over the floor": over, "inside 95 %": float(np.mean(inside))})


def smoothing(walk: float, warm_up: float, sessions: int) -> Line:
    """Rms per axis [N] in the middle of a contact, at its end, and over all of it: forwards, and from both sides."""
    sums = {name: np.zeros(2) for name in ("middle", "all", "end")}
    inside, count = 0.0, 0
    for number in range(sessions):
        time, zero, seen, begins = _session(walk, warm_up, np.random.default_rng([1, number]))
        for way in (0, 1):
            found = follow(time, seen, drift_of(walk, warm_up), smooth=bool(way))
            off = _off(found, time, zero)
            for begin in begins:
                during = (found.time > begin) & (found.time < begin + CONTACT)
                sums["all"][way] += float(np.mean(off[during] ** 2))
                for name, at in (("middle", CONTACT / 2), ("end", CONTACT - 0.5)):
                    sums[name][way] += float(np.mean(off[np.searchsorted(found.time, begin + at)] ** 2))
                if way:
                    k = int(np.searchsorted(found.time, begin + CONTACT / 2))
                    square = off[k] @ np.linalg.solve(found.covariance[k, :3, :3], off[k])
                    inside, count = inside + float(square <= CHI2_95), count + 1
    figures = dict[str, float]()
    for name, total in sums.items():
        forward, both = (float(value) for value in np.sqrt(total / (sessions * CONTACTS)))
        figures |= {f"{name}, forward": forward, f"{name}, both": both, f"{name}, ratio": both / forward}
    what = f"smoothed, walk {1e3 * walk:.2g} mN/sqrt(s), warm-up {60 * warm_up:.2g} N/min, {count} contacts"
    return Line(what, {**figures, "inside 95 %, middle": inside / count})


def touches(
    name: str, onset: float, trials: int, make: Callable[[np.random.Generator, float, float], list[Touch]]
) -> Line:
    """How much further off the zero is for touches: the same log with and without them, at their end and 3 s later."""
    more, after, eaten = list[float](), list[float](), list[float]()
    for number in range(trials):
        rng = np.random.default_rng([2, number])
        begin, end = 60.0, 80.0 + 2 * onset
        time = np.arange(0.0, end + 5.0, 1.0 / RATE)
        zero = simulate_drift(time, drift_of(WALK), rng)
        noise = NOISE * rng.standard_normal((len(time), 6))
        load = wrenches(time, make(rng, begin, end), rng)
        found = follow(time, zero + noise + load, drift_of(WALK))
        # what was not eaten is what a follower would know that was told of the touch: it stands still meanwhile
        told = follow(time, zero + noise, drift_of(WALK), touched=(time >= begin) & (time <= end))
        off, base = (np.linalg.norm(_off(each, time, zero), axis=1) for each in (found, told))
        at, later = np.searchsorted(found.time, [end - onset - 0.5, end + 3.0])
        more.append(float(off[at] - base[at]))
        after.append(float(off[later] - base[later]))
        eaten.append(float(np.linalg.norm((found.zero[at] - told.zero[at])[:3])))
    middle, high, eaten_high = np.median(more), np.percentile(more, 95), np.percentile(eaten, 95)
    figures = {"median more": middle, "95 %": high, "eaten, 95 %": eaten_high, "eaten, most": max(eaten)}
    return Line(f"{name}, onset {onset:g} s, {trials} trials", {**figures, "3 s later, most": max(after)})


def jumps(size: float, seconds: float, trials: int, skin: bool = False, alone: bool = False) -> Line:
    """A zero that jumps by a size [N] within seconds: how far off it is 5 s after, and how many were followed."""
    left, followed, said = list[float](), 0, 0
    for number in range(trials):
        rng = np.random.default_rng([3, number])
        time = np.arange(0.0, 2 * AT + seconds, 1.0 / RATE)
        way = rng.standard_normal(6)
        way[:3] /= np.linalg.norm(way[:3])
        way[3:] *= 0.0375 / np.linalg.norm(way[3:])
        zero = simulate_drift(time, drift_of(WALK), rng)
        zero = zero + size * np.clip((time - AT) / max(seconds, 1e-9), 0.0, 1.0)[:, None] * way
        seen = readings(time, zero, [], rng)
        told = np.zeros(len(time), bool) if skin else None
        found = follow(time, seen, drift_of(WALK), touched=told, alone=alone)
        off = np.linalg.norm(_off(found, time, zero), axis=1)
        left.append(float(off[np.searchsorted(found.time, AT + seconds + 5.0)]))
        followed += left[-1] < 0.1 * size + 0.03
        said += any(not jump.followed for jump in found.jumps)
    how = "a skin feels nothing" if skin else "one touch at a time" if alone else "no skin"
    return Line(
        f"jump of {size:g} N over {seconds:g} s, {how}, {trials} trials",
        {"median off 5 s after": float(np.median(left)), "followed": followed / trials, "said": said / trials},
    )


def payload(wrong: float, trials: int) -> Iterator[Line]:
    """The payload weighs more than stated while the arm turns: rms [N] in 60 s of contact, and for the right weight."""
    load = Payload(np.array([0.0, 0.0, -5.0]), np.zeros(3), np.array([0.0, 0.0, 0.05]), np.zeros(3))
    for error in (0.0, wrong):
        total, count, held = 0.0, 0, list[float]()
        for number in range(trials):
            rng = np.random.default_rng([4, number])
            time = np.arange(0.0, 240.0, 1.0 / RATE)
            zero = simulate_drift(time, drift_of(WALK), rng)
            tilt = np.stack([0.5 * np.sin(time / 9.0), 0.4 * np.sin(time / 13.0), 0 * time, np.ones(len(time))], axis=1)
            tilt[: round(2 * RATE)] = tilt[0]
            tilt /= np.linalg.norm(tilt, axis=1, keepdims=True)
            weight = np.einsum("nji,j->ni", rotation_from_quaternion(tilt), load.weight * (1 + error / 5.0))
            hung = np.concatenate([weight, np.cross(load.center_of_mass, weight)], axis=1)
            seen = readings(time, zero, [Touch(150.0, 210.0, 10.0, 0.3, 0.3)], rng) + hung
            found = follow(time, seen, drift_of(WALK), payload=load, orientation=tilt)
            during = (found.time > 150.0) & (found.time < 210.0)
            hangs = weight[np.minimum(np.searchsorted(time, found.time), len(time) - 1)] / (5.0 + error)
            more = (found.coefficient[:, 0] - error)[:, None]
            off = _off(found, time, zero) + hangs * more  # of the wrench, weight and zero together
            total, count = total + float(np.sum(np.mean(off[during] ** 2, axis=1))), count + int(during.sum())
            free = (found.time > 10.0) & (found.time < 150.0)
            held.append(float(np.mean(found.status[free] > 0)))
        yield Line(
            f"payload wrong by {error:g} N, {trials} trials",
            {"rms an axis": float(np.sqrt(total / count)), "held while free": float(np.mean(held))},
        )
