"""The page: every figure that was asked for, measured, beside the prototype's."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evidence.machine import machine
from experiments.fused_contacts.bench import Conditions
from experiments.fused_contacts.study import Alarms, Forces, Places, Sizes, alarms, forces, harder, places

__all__ = ["Check", "page"]

FORCE = {2: 0.6, 3: 0.95, 5: 1.5}  # [N] median error that is asked for
FOUND = {1: (1.0, 0.90), 2: (4.0, 0.95), 3: (8.0, 0.95)}  # beside so many: newtons, share
THEIRS = {2: "0.55 / 2.0", 3: "0.88 / 2.4", 5: "1.39 / 3.2"}  # the prototype's
WIDE = 2e-3


@dataclass(frozen=True)
class Check:
    """A target, and what was measured."""

    what: str
    asked: str
    got: str
    met: bool


def page(sizes: Sizes, seeds: Sequence[int], checks: list[Check]) -> str:
    """The page as Markdown; `checks` gets every target."""
    parts = [
        _forces(sizes, seeds, checks),
        _alarms(sizes, seeds, checks),
        _places(sizes, seeds, checks),
        _assumed(sizes, seeds),
    ]
    table = ["| asked | target | got | |", "| --- | --- | --- | --- |"]
    table += [f"| {each.what} | {each.asked} | {each.got} | {'met' if each.met else '**missed**'} |" for each in checks]
    return "\n".join([*_head(sizes, seeds), *table, "", *(line for part in parts for line in [*part, ""])])


def _head(sizes: Sizes, seeds: Sequence[int]) -> list[str]:
    return [
        "# Several contacts at once: a skin and a force/torque sensor",
        "",
        "Written by `python -m experiments.fused_contacts`; nothing here is typed by hand but targets and the",
        "prototype's figures. Truth is plain geometry and random numbers (`bench.py`), never the estimator.",
        "",
        *[f"- {line}" for line in machine()],
        f"- seeds {seeds[0]} to {seeds[-1]}; of each {sizes.bodies} bodies with {sizes.touches} touches a row, and for",
        f"  unseen places {sizes.searched} bodies with {sizes.searches}",
        "",
        "Contacts at least 25 mm apart, uniform on the skin, 2 to 12 N along the normal; tangential forces uniform in",
        "a disc of 0.5 of that (the estimator assumes this, and a bound of 0.6). The skin's forces are 10 % off and",
        "its places 2 mm: as the root mean square of the distance, 1.4 mm along each tangent. Rows that say *2 mm",
        "along each* read it the harder way. The wrench has 0.04 N and 1.5 mN m of noise. The forearm is a cone of",
        "32 to 40 mm radius and 160 to 220 mm length, the box a link with flat sides; nothing was fitted on either.",
        "",
    ]


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _forces(sizes: Sizes, seeds: Sequence[int], checks: list[Check]) -> list[str]:
    lines = [
        "## Forces",
        "",
        "Error of one contact's force [N], median / 95 % of them. The last columns: 95 % ellipsoids that hold the",
        "truth, touches in which a cone binds.",
        "",
        "| contacts | ours | prototype | skin alone | minimum norm | iDynTree | held | binds |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    usual = Conditions()
    rows = [("forearm", "", usual), ("forearm", ", 2 mm along each", harder(usual, place=WIDE))]
    rows += [("box", ", box", usual), ("forearm", ", skin 20 % off", harder(usual, gain=0.2))]
    for kind, text, now in rows:
        for count in (1, 2, 3, 5) if text else (1, 2, 3, 5, 8):
            found = _joined([forces(kind, count, now, sizes, seed, others=not text) for seed in seeds])
            _say(f"forces {kind}{text} {count}")
            lines.append(_force_line(found, text))
            if not text and count in FORCE:
                checks += _force_checks(found)
    return lines


def _joined(parts: list[Forces]) -> Forces:
    first = parts[0]
    held, bound = (float(np.mean([getattr(part, name) for part in parts])) for name in ("held", "bound"))
    ways = [
        np.concatenate([getattr(part, name) for part in parts]) for name in ("ours", "skin", "shortest", "idyntree")
    ]
    return Forces(first.count, *ways, held, bound)


def _both(errors: np.ndarray) -> str:
    if np.isnan(errors).all():
        return ""
    return f"{np.median(errors):.2f} / {np.percentile(errors, 95):.1f}"


def _force_line(found: Forces, text: str) -> str:
    ways = [_both(each) for each in (found.skin, found.shortest, found.idyntree)]
    theirs = "" if text else THEIRS.get(found.count, "")
    shares = f"{100 * found.held:.1f} % | {100 * found.bound:.1f} %"
    return f"| {found.count}{text} | {_both(found.ours)} | {theirs} | {' | '.join(ways)} | {shares} |"


def _force_checks(found: Forces) -> list[Check]:
    count, median = found.count, float(np.median(found.ours))
    ratio = {name: median / float(np.median(way)) for name, way in (("", found.shortest), ("iDynTree", found.idyntree))}
    return [
        Check(f"{count} contacts: median error", f"<= {FORCE[count]} N", f"{median:.2f} N", median <= FORCE[count]),
        Check(
            f"{count} contacts: over iDynTree's",
            "<= 0.25",
            f"{ratio['iDynTree']:.2f} (over minimum norm {ratio['']:.2f})",
            max(ratio.values()) <= 0.25,
        ),
        Check(
            f"{count} contacts: 95 % ellipsoids hold",
            "93-97 %",
            f"{100 * found.held:.1f} %",
            0.93 <= found.held <= 0.97,
        ),
    ]


def _alarms(sizes: Sizes, seeds: Sequence[int], checks: list[Check]) -> list[str]:
    lines = [
        "## Alarms",
        "",
        "1 % of false alarms is asked for. *Chi-square* is what its own 99 % would give.",
        "",
        "| beside | false alarms | chi-square | found |",
        "| --- | --- | --- | --- |",
    ]
    false = dict[str, list[float]]()
    for kind, text, place in (
        ("forearm", "", Conditions().place),
        ("forearm", ", 2 mm along each", WIDE),
        ("box", ", box", Conditions().place),
    ):
        for count in range(4 if "along" in text else 7):
            extra = {1: (1.0, 2.0), 2: (4.0,), 3: (8.0,)}.get(count, ())
            now = harder(Conditions(), place=place)
            parts = [alarms(kind, count, extra, now, sizes, seed) for seed in seeds]
            _say(f"alarms {kind}{text} {count}")
            found = _mean(parts)
            shares = ", ".join(f"{force:g} N {100 * share:.0f} %" for force, share in found.found.items())
            lines.append(f"| {count}{text} | {100 * found.false:.2f} % | {100 * found.chi:.2f} % | {shares} |")
            false.setdefault(kind + text, []).append(found.false)
            if not text and count in FOUND:
                force, least = FOUND[count]
                got = found.found[force]
                what = f"{force:g} N unseen beside {count}: found"
                checks.append(Check(what, f">= {100 * least:.0f} %", f"{100 * got:.1f} %", got >= least))
    for name, shares in false.items():
        got = f"{100 * min(shares):.2f} to {100 * max(shares):.2f} %"
        inside = min(shares) >= 0.005 and max(shares) <= 0.02
        checks.append(Check(f"false alarms beside 0 to {len(shares) - 1}, {name}", "0.5-2 %", got, inside))
    return lines


def _mean(parts: list[Alarms]) -> Alarms:
    found = {force: float(np.mean([part.found[force] for part in parts])) for force in parts[0].found}
    false, chi = (float(np.mean([getattr(part, name) for part in parts])) for name in ("false", "chi"))
    return Alarms(parts[0].count, false, chi, found)


def _places(sizes: Sizes, seeds: Sequence[int], checks: list[Check]) -> list[str]:
    lines = [
        "## Where an unseen contact is",
        "",
        "The likeliest place, and the fewest places that hold 95 % of the belief: whether the nearest place on the",
        "contact's own side is one of them (normals within 60 degrees); forces of all with one contact there. The",
        "prototype's median for 5 N: 10, 23, 33 mm beside one, two, three.",
        "",
        "| beside | unseen | region holds | its share of the skin | place off [mm] | seen force off [N] | unseen [N] |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for kind, counts in (("forearm", (1, 2, 3)), ("box", (1, 2))):
        least = list[Places]()
        for count in counts:
            for force in (5.0, 12.0):
                parts = [places(kind, count, force, Conditions(), sizes, seed) for seed in seeds]
                _say(f"places {kind} {count} {force}")
                held, area = (float(np.mean([getattr(part, name) for part in parts])) for name in ("held", "area"))
                off, seen, unseen = (
                    np.concatenate([getattr(part, name) for part in parts]) for name in ("off", "seen", "unseen")
                )
                least.append(Places(count, force, held, area, off, seen, unseen))
                lines.append(
                    f"| {count}{', box' if kind == 'box' else ''} | {force:g} N | {100 * held:.1f} % | "
                    f"{100 * area:.1f} % | {1e3 * np.median(off):.1f} | {np.median(seen):.2f} | "
                    f"{np.median(unseen):.2f} |"
                )
        worst = min((each for each in least if each.count < 3), key=lambda each: each.held)
        got = f"{100 * worst.held:.1f} % at worst ({worst.force:g} N beside {worst.count})"
        checks.append(Check(f"95 % region of places holds, {kind}, beside 1, 2", ">= 90 %", got, worst.held >= 0.9))
    return lines


def _assumed(sizes: Sizes, seeds: Sequence[int]) -> list[str]:
    lines = [
        "## Where friction is not as assumed",
        "",
        "Three contacts on the forearm; tangential forces in a disc of another size than the 0.5 that is assumed.",
        "",
        "| friction | ours [N] | held | binds | false alarms | 8 N found |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for friction in (0.2, 0.4, 0.6):
        now = harder(Conditions(), friction=friction)
        found = _joined([forces("forearm", 3, now, sizes, seed, others=False) for seed in seeds])
        told = _mean([alarms("forearm", 3, (8.0,), now, sizes, seed) for seed in seeds])
        _say(f"friction {friction}")
        lines.append(
            f"| {friction:g} | {_both(found.ours)} | {100 * found.held:.1f} % | {100 * found.bound:.1f} % | "
            f"{100 * told.false:.2f} % | {100 * told.found[8.0]:.0f} % |"
        )
    return lines
