"""Several contacts at once from a skin and a force/torque sensor, beside the skin alone and minimum norm."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from claims.page import asked, fill, table
from claims.papers.fused_contacts.bench import Conditions
from claims.papers.fused_contacts.study import Forces, Sizes, alarms, forces, places
from claims.row import Row

FOLDER = Path(__file__).parent
SEED = 500
SMALL = Sizes(bodies=2, touches=10, searched=1, searches=4)
FORCE = {2: 0.6, 3: 0.95, 5: 1.5}  # [N] median error that is asked for
FOUND = {1: (1.0, 0.90), 2: (4.0, 0.95), 3: (8.0, 0.95)}  # beside so many: newtons, share
THEIRS = {2: "0.55 / 2.0", 3: "0.88 / 2.4", 5: "1.39 / 3.2"}  # the prototype's
USUAL, WIDE = Conditions(), Conditions(place=2e-3)
Tables = dict[str, list[list[str]]]


def rows(small: bool, seed: int = SEED) -> Iterator[Row]:
    """Yield every target, measured; another seed draws all anew."""
    begin, sizes, made = time.process_time(), SMALL if small else Sizes(), Tables()
    found = list[Row]()
    for part in (_forces, _alarms, _places, _assumed):
        for row in part(sizes, seed, made):
            found.append(row)
            yield row
    heads = {
        "forces": "contacts, ours, prototype, skin alone, minimum norm, iDynTree, held, binds",
        "alarms": "beside, false alarms, chi-square, found",
        "places": "beside, unseen, region holds, its share of the skin, place off [mm], seen force off [N], unseen [N]",
        "friction": "friction, ours [N], held, binds, false alarms, 8 N found",
    }
    tables = {name: table(head.split(", "), made[name]) for name, head in heads.items()}
    if not small and seed == SEED:
        took = time.process_time() - begin
        fill(FOLDER, seed=seed, sizes=sizes, took=took, asked=asked(found), **tables)


def _forces(sizes: Sizes, seed: int, made: Tables) -> Iterator[Row]:
    made["forces"] = []
    for kind, text, now in (
        ("forearm", "", USUAL),
        ("forearm", ", 2 mm along each", WIDE),
        ("box", ", box", USUAL),
        ("forearm", ", skin 20 % off", replace(USUAL, gain=0.2)),
    ):
        for count in (1, 2, 3, 5) if text else (1, 2, 3, 5, 8):
            found = forces(kind, count, now, sizes, seed, others=not text)
            ways = [_both(each) for each in (found.skin, found.shortest, found.idyntree)]
            theirs = "" if text else THEIRS.get(count, "")
            made["forces"].append([f"{count}{text}", _both(found.ours), theirs, *ways, *_shares(found)])
            if not text and count in FORCE:
                median = float(np.median(found.ours))
                norm, tree = (median / float(np.median(way)) for way in (found.shortest, found.idyntree))
                met, got = median <= FORCE[count], f"{median:.2f} N"
                yield Row(f"{count} contacts: median error", f"<= {FORCE[count]} N", got, met)
                got = f"{tree:.2f} (over minimum norm {norm:.2f})"
                yield Row(f"{count} contacts: over iDynTree's", "<= 0.25", got, max(norm, tree) <= 0.25)
                met, got = 0.93 <= found.held <= 0.97, _shares(found)[0]
                yield Row(f"{count} contacts: 95 % ellipsoids hold", "93-97 %", got, met)


def _both(errors: np.ndarray) -> str:
    return "" if np.isnan(errors).all() else f"{np.median(errors):.2f} / {np.percentile(errors, 95):.1f}"


def _shares(found: Forces) -> list[str]:
    return [f"{100 * found.held:.1f} %", f"{100 * found.bound:.1f} %"]


def _alarms(sizes: Sizes, seed: int, made: Tables) -> Iterator[Row]:
    made["alarms"], false = [], dict[str, list[float]]()
    for kind, text, now in (("forearm", "", USUAL), ("forearm", ", 2 mm along each", WIDE), ("box", ", box", USUAL)):
        for count in range(4 if "along" in text else 7):
            found = alarms(kind, count, {1: (1.0, 2.0), 2: (4.0,), 3: (8.0,)}.get(count, ()), now, sizes, seed)
            shares = ", ".join(f"{force:g} N {100 * share:.0f} %" for force, share in found.found.items())
            made["alarms"].append([f"{count}{text}", f"{100 * found.false:.2f} %", f"{100 * found.chi:.2f} %", shares])
            false.setdefault(kind + text, []).append(found.false)
            if not text and count in FOUND:
                force, least = FOUND[count]
                got, target = found.found[force], f">= {100 * least:.0f} %"
                yield Row(f"{force:g} N unseen beside {count}: found", target, f"{100 * got:.1f} %", got >= least)
    for name, each in false.items():
        got, met = f"{100 * min(each):.2f} to {100 * max(each):.2f} %", min(each) >= 0.005 and max(each) <= 0.02
        yield Row(f"false alarms beside 0 to {len(each) - 1}, {name}", "0.5-2 %", got, met)


def _places(sizes: Sizes, seed: int, made: Tables) -> Iterator[Row]:
    made["places"] = []
    for kind, text, counts in (("forearm", "", (1, 2, 3)), ("box", ", box", (1, 2))):
        every = [places(kind, count, force, USUAL, sizes, seed) for count in counts for force in (5.0, 12.0)]
        for each in every:
            shares = f"{100 * each.held:.1f} %", f"{100 * each.area:.1f} %", f"{1e3 * np.median(each.off):.1f}"
            off = f"{np.median(each.seen):.2f}", f"{np.median(each.unseen):.2f}"
            made["places"].append([f"{each.count}{text}", f"{each.force:g} N", *shares, *off])
        worst = min((each for each in every if each.count < 3), key=lambda each: each.held)
        got = f"{100 * worst.held:.1f} % at worst ({worst.force:g} N, others: {worst.count})"
        yield Row(
            f"{kind}, one contact unseen, 1 or 2 others: its place in the 95 % region",
            ">= 90 %",
            got,
            worst.held >= 0.9,
        )
        held = [each.inside for each in every]
        got, met = f"{100 * min(held):.1f} to {100 * max(held):.1f} %", min(held) >= 0.9 and max(held) <= 0.97
        yield Row(f"{kind}, one contact unseen: forces of the others in their 95 % ellipsoids", "90-97 %", got, met)


def _assumed(sizes: Sizes, seed: int, made: Tables) -> Iterator[Row]:
    made["friction"] = []
    for friction in (0.2, 0.4, 0.6):
        now = replace(USUAL, friction=friction)
        found = forces("forearm", 3, now, sizes, seed, others=False)
        told = alarms("forearm", 3, (8.0,), now, sizes, seed)
        cells = [_both(found.ours), *_shares(found), f"{100 * told.false:.2f} %", f"{100 * told.found[8.0]:.0f} %"]
        made["friction"].append([f"{friction:g}", *cells])
        got = f"{cells[0]} N, {cells[1]} held, {cells[3]} false alarms, 8 N found in {cells[4]}"
        yield Row(f"3 contacts, friction {friction:g} instead of 0.5: median / 95 % error", "", got)
