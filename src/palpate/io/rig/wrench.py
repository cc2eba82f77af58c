"""What all sensors of wrenches have in common when they are built from a rig: locator, mounting, filter, tare."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.contact.locate import Locator
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.errors import InputError
from palpate.io.rig.kind import Prepared
from palpate.io.rig.surface import RigSurface
from palpate.io.rig.tables import RigFilter
from palpate.sensors.drift import Drift
from palpate.sensors.recording import Recording
from palpate.sensors.wrench_sensor import WrenchSensor
from palpate.surfaces import Mesh, Surface

if TYPE_CHECKING:
    from palpate.io.rig.rig import Rig

__all__ = ["first_seconds", "noted_filter", "wrench_estimator"]


def wrench_estimator(
    rig: Rig,
    sensor: WrenchSensor,
    head: Recording | None,
    *,
    tare: float | None,
    mounted: bool = True,
    drift: Drift | None = None,
    **options: Any,
) -> Prepared:
    """The estimator of a sensor of wrenches on the rig's surface, tared where the log begins unloaded.

    Args:
        rig: what the user wrote.
        sensor: prepared.
        head: the start of the log; None: a live loop, which tares when it will.
        tare: [s] at the start of the log in which nothing is touched; None: no tare.
        mounted: wrenches are about the sensor's frame; not where they were calibrated about the surface's.
        drift: of the sensor's zero, which is followed while nothing is touched; None: it is not.
        options: of `Locator`, such as a soft layer.
    """
    surface = rig_surface(rig)
    settings, contact = rig.estimate, rig.estimate.contact
    locator = Locator(
        surface,
        method=settings.method,
        friction=settings.friction,
        torsion=settings.torsion,
        noise=sensor.noise,
        on=None if contact is None else contact.on,
        off=None if contact is None else contact.off,
        **options,
    )
    table, rate = rig_filter(rig, head)
    uncertain = None if rig.surface is None else rig.surface.pose_covariance
    estimator = WrenchEstimator(
        locator,
        sensor,
        rig.mount(),
        None if uncertain is None else np.asarray(uncertain),
        mounted=mounted,
        filter=table.filter(),
        rate=rate,
        live=head is None,
        placement=0.0 if rig.surface is None else rig.surface.placement,
        drift=drift,
    )
    made = Prepared(estimator, said=noted_filter(table, rate), facts=_facts(rig, estimator, table, rate))
    if isinstance(surface, Mesh) and surface.coverage and surface.touchable is None:
        made.said.append(f"{surface.coverage} cannot be reached from outside: no contacts there (inspect MESH)")
    if head is not None and tare is not None:
        tared = estimator.tare(first_seconds(head, tare))
        made.said.append(tared.said)
        made.doubted += [tared.doubt] if tared.doubt else []
    if contact is None:
        made.said.append(
            f"a contact begins at {locator.on:.3g} N and ends at {locator.off:.3g} N, or more where payload, motion, "
            "tare or mounting are less certain than the noise"
        )
    if mounted and uncertain is None and sensor.noise is not None:
        made.said.append("where the surface sits is taken as exact in the ellipses (calibrate mounting)")
    return made


def rig_surface(rig: Rig) -> Surface:
    """What is touched, with the kernels that search it loaded."""
    if rig.surface is None:
        raise InputError("the rig has no [surface].", where="rig")
    files = [path for path in rig.surface.files(rig.folder).values() if path.is_file()]
    return _surface(rig.surface, rig.folder, tuple((path.stat().st_mtime_ns, path.stat().st_size) for path in files))


@lru_cache(maxsize=1)
def _surface(stated: RigSurface, folder: Path, files: tuple[tuple[int, int], ...]) -> Surface:
    """Read and prepared once for all logs of a rig, as long as its files stay as they are."""
    surface = stated.load(folder)
    surface.prepared()
    return surface


def rig_filter(rig: Rig, head: Recording | None) -> tuple[RigFilter, float | None]:
    """The filter and the rate [Hz] of samples; none where there is too little to be filtered."""
    stated = rig.filter
    if stated.kind == "none" or stated.rate is not None or head is None:
        return stated, stated.rate
    if len(head) < 2:
        return RigFilter(), None
    steps = np.diff(head.time)
    if np.count_nonzero(steps > 0) <= len(steps) / 2:
        raise InputError(
            "most times repeat or are missing, so the rate that the filter needs is not known.",
            where=head.source,
            hint="Give the rate [Hz] in the rig's [filter], or use --filter none.",
        )
    return stated, head.rate()


def noted_filter(table: RigFilter, rate: float | None) -> list[str]:
    """What the filter does at this rate."""
    made = table.filter()
    return [] if made is None or rate is None else [made.describe(rate)]


def first_seconds(head: Recording, seconds: float) -> Recording:
    """The start of a log.

    Raises:
        InputError: it has no times.
    """
    known = head.time[np.isfinite(head.time)]
    if not len(known):
        raise InputError("has no times, so its first seconds are not known.", where=head.source)
    return head.picked(head.time <= known[0] + seconds)


def _facts(rig: Rig, estimator: WrenchEstimator, table: RigFilter, rate: float | None) -> dict[str, object]:
    """What was in force, as it stands in OUTPUT.toml."""
    drift = estimator.drift
    locator, smooth = estimator.locator, table.filter()
    return {
        **vars(rig.estimate),
        "contact": f"on {locator.on:g} N, off {locator.off:g} N",
        "crease": None if rig.surface is None else rig.surface.crease,
        "filter": "none" if smooth is None or rate is None else f"{smooth} at {rate:.6g} Hz",
        "drift": None if drift is None else f"walk {np.array2string(drift.walk, precision=3)} a root second",
        "noise": None if locator.noise is None else np.sqrt(np.diag(locator.noise)).tolist(),
    }
