"""The sections of a report that say how it was done: settings, models, inputs, time."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from platform import python_version

import numpy as np

from palpate.cli.calibrate_payload import figures
from palpate.cli.screen import measured, percent
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.io.rig import Rig
from palpate.spatial.pose import skew
from palpate.surfaces.mesh import Mesh
from palpate.viewer.report import Section, Table

__all__ = ["budget", "inputs", "models", "settings", "surface_name"]


def surface_name(rig: Rig) -> str:
    """What was touched, in a word."""
    kind = rig.surface.kind.replace("_", " ")
    return Path(str(rig.surface.mesh)).name if kind == "mesh" else f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"


def settings(rig: Rig, estimator: WrenchEstimator, rate: float) -> Section:
    """What the answers depend on, defaults included; `rate` [Hz] is that of the log."""
    locator, noise = estimator.locator, estimator.sensor.noise
    deviation = None if noise is None else np.sqrt(np.diag(noise))
    facts = [
        ("method", rig.estimate.method),
        ("friction, at most", f"{rig.estimate.friction:g} (tangent of the angle between force and normal)"),
        ("torsion, at most", f"{1e3 * rig.estimate.torsion:g} mm (torque about the normal over normal force)"),
        ("a contact", f"begins at {locator.on:.3g} N, ends at {locator.off:.3g} N"),
        ("noise of a reading", "not known" if deviation is None else _noise(deviation)),
        ("filter", _filter(rig, estimator, rate)),
        ("wrench", f"in the {estimator.sensor.sensor.frame}'s frame, logged axes {', '.join(rig.force_torque.axes)}"),
        ("surface", _surface(rig, estimator)),
    ]
    if rig.estimate.tare is not None:
        facts.append(("tare", f"over the first {rig.estimate.tare:g} s"))
    if rig.orientation.topic is not None or rig.orientation.offset:
        gap = f"gaps of up to {rig.orientation.max_gap:g} s are interpolated"
        facts.append(("orientation", f"clock offset {1e3 * rig.orientation.offset:g} ms; {gap}"))
    return Section("Settings in force", facts=tuple(facts))


def _noise(deviation: np.ndarray) -> str:
    return f"{deviation[:3].max():.3g} N and {deviation[3:].max():.3g} N m (one standard deviation, largest axis)"


def _filter(rig: Rig, estimator: WrenchEstimator, rate: float) -> str:
    known, rate = estimator.filter, estimator.rate or rate
    if known is None:
        return "none"
    return known.describe(rate) if np.isfinite(rate) else rig.filter.kind


def _surface(rig: Rig, estimator: WrenchEstimator) -> str:
    surface = estimator.locator.surface
    facets = f", {len(surface.faces):,} facets" if isinstance(surface, Mesh) else ""
    return f"{surface_name(rig)}{facets}, {1e3 * surface.size:.4g} mm across"


def models(rig: Rig, estimator: WrenchEstimator) -> Section:
    """Payload and mounting, with what is unsure about them."""
    payload = estimator.sensor.payload
    said = [("payload", "none: wrenches are taken as they are")] if payload is None else list(figures(payload))
    return Section(
        "Payload and mounting", facts=tuple((name, str(value)) for name, value in [*said, *_mounting(rig, estimator)])
    )


def _mounting(rig: Rig, estimator: WrenchEstimator) -> list[tuple[str, str]]:
    pose, uncertain = estimator.mount, rig.surface.pose_covariance
    place, turn = 1e3 * pose.translation, np.degrees(pose.rotation_vector())
    if uncertain is None:
        stated = (("mounting", place, "mm"), ("turned by", turn, "deg"))
        return [
            (name, f"({', '.join(f'{v:.2f}' for v in three)}) {unit}, not calibrated") for name, three, unit in stated
        ]
    covariance = np.asarray(uncertain)
    moves = np.concatenate([-skew(pose.translation), np.eye(3)], axis=1)  # what a small motion does to the origin
    spread = 1e3 * np.sqrt(np.diag(moves @ covariance @ moves.T).clip(min=0))
    turned = np.degrees(np.sqrt(np.diag(covariance)[:3].clip(min=0)))
    return [("mounting", measured(place, spread, "mm")), ("turned by", measured(turn, turned, "deg"))]


def inputs(provenance: Mapping[str, str]) -> Section:
    """Names and hashes of the files, versions, options."""
    used = ", ".join(f"{name} {release}" for name, release in (("numpy", np.__version__), ("Python", python_version())))
    facts = [("versions", f"palpate {provenance.get('palpate', 'unknown')}, {used}")]
    for name, said in provenance.items():
        if name != "palpate":
            facts.append((name.replace("_", " "), said.replace(" sha256:", ", SHA-256 ")))
    return Section("Inputs and options", facts=tuple(facts))


def budget(stages: Mapping[str, float], samples: int) -> Section:
    """Seconds of each stage, and microseconds a sample."""
    total, count = sum(stages.values()), max(samples, 1)
    if not total:
        return Section("Time budget")
    rows = [
        (name, f"{spent:.3f}", f"{1e6 * spent / count:.2f}", percent(spent / total))
        for name, spent in (*stages.items(), ("all", total))
    ]
    header = ("stage", "time [s]", "per sample [us]", "share")
    return Section("Time budget", tables=(Table(header, tuple(rows)),))
