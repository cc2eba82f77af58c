"""Build the estimator of any sensor of wrenches from a rig: locator, mounting, filter and tare."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.contact.locate import Locator
from palpate.contact.plausibility import lines_of_action
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.errors import InputError
from palpate.setup.built import BuiltEstimator
from palpate.setup.setup import Setup
from palpate.setup.tables import RigFilter
from palpate.signals.drift import Drift
from palpate.signals.recording import FORCE, TORQUE, Recording
from palpate.signals.wrench_sensor import WrenchSensor
from palpate.spatial.pose import Pose
from palpate.surfaces import Mesh
from palpate.surfaces.mesh import plausible_size


def wrench_estimator(
    setup: Setup,
    sensor: WrenchSensor,
    *,
    tare: float | None,
    mounted: bool = True,
    drift: Drift | None = None,
    **options: Any,
) -> BuiltEstimator:
    """Return a `BuiltEstimator` of a sensor of wrenches on the link's surface, tared if the log begins unloaded.

    Args:
        setup: the link and its sensors.
        sensor: the sensor, ready for readings.
        tare: [s] at the start of the log in which nothing is touched; None: no tare.
        mounted: wrenches are in the sensor's frame. False: they were calibrated in the surface's frame.
        drift: drift of the sensor's bias, which is followed while nothing is touched; None: it is not followed.
        options: further options of `Locator`, such as a soft layer.

    Raises:
        InputError: a setting or a file of the rig cannot be used, the filter needs a rate that is not known or does not
            fit it, or the log has no times for the tare.
        GeometryError: the file of the surface has no usable surface.
    """
    surface, link, head = setup.link.surface(), setup.link, setup.head
    if isinstance(surface, Mesh) and head is not None:
        _require_size(surface, link.name, link.mount if mounted else Pose.identity(), head)
    surface.prepared()  # once for all logs of a rig
    settings, contact = setup.estimate, setup.estimate.contact
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
    table, rate = setup.smoothing()
    estimator = WrenchEstimator(
        locator,
        sensor,
        link.mount,
        link.mount_covariance,
        mounted=mounted,
        filter=table.filter(),
        rate=rate,
        live=head is None,
        placement=link.placement,
        drift=drift,
    )
    made = BuiltEstimator(estimator, notes=noted_filter(table, rate), settings=_facts(setup, estimator, table, rate))
    if isinstance(surface, Mesh) and surface.coverage and surface.touchable is None:
        made.notes.append(
            f"{surface.coverage} cannot be reached from outside: no contacts are found there (`palpate inspect MESH`)"
        )
    if head is not None and tare is not None:
        made.tared(estimator.tare(head.first(tare)))
    if contact is None:
        made.notes.append(
            f"a contact begins at {locator.on:.3g} N and ends at {locator.off:.3g} N; both are higher where payload, "
            "motion, tare or mounting are less certain than the noise"
        )
    if mounted and link.mount_covariance is None and sensor.noise is not None:
        made.notes.append(
            "the ellipses take the pose of the surface as exact: `palpate calibrate mounting` estimates its error"
        )
    return made


def _require_size(mesh: Mesh, name: str, mount: Pose, head: Recording) -> None:
    """Raise an InputError where a mesh has no usual size and the log's wrenches do not fit it: its unit is wrong."""
    if plausible_size(mesh.size) or not {FORCE, TORQUE} <= head.channels.keys():
        return
    wrenches = head.wrenches()
    changes = wrenches - np.nanmedian(wrenches, axis=0) if np.isfinite(wrenches).any() else wrenches
    if lines_of_action(changes, mount.apply(mesh.centre), 10 * mesh.size):
        raise InputError(
            f"is {1e3 * mesh.size:.3g} mm across, and the wrenches of the log do not fit a body of this size.",
            where=name,
            hint="Correct its unit (unit in [surface], --unit), or the unit of the torques.",
        )


def noted_filter(table: RigFilter, rate: float | None) -> list[str]:
    """Return a list of the note on the filter at the rate [Hz]; [] without filter or rate.

    Raises:
        InputError: the cut-off does not fit the rate, or `q` is too small a fraction of `r`.
    """
    made = table.filter()
    return [] if made is None or rate is None else [made.describe(rate)]


def _facts(setup: Setup, estimator: WrenchEstimator, table: RigFilter, rate: float | None) -> dict[str, object]:
    """Return the settings in force, name -> value, as OUTPUT.toml records them."""
    drift = estimator.drift
    locator, smooth = estimator.locator, table.filter()
    return {
        **vars(setup.estimate),
        "contact": f"on {locator.on:g} N, off {locator.off:g} N",
        "crease": setup.link.settings.get("crease"),
        "filter": "none" if smooth is None or rate is None else f"{smooth} at {rate:.6g} Hz",
        "drift": None if drift is None else f"walk {np.array2string(drift.walk, precision=3)} a root second",
        "noise": None if locator.noise is None else np.sqrt(np.diag(locator.noise)).tolist(),
    }
