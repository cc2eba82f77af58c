"""The main figures of each model, as `inspect` and the commands that make them print them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.io.units import measured
from palpate.sensors.fisheye import Fisheye
from palpate.sensors.force_torque import Payload
from palpate.sensors.intensity import Intensity
from palpate.sensors.load_cells import LoadCells
from palpate.sensors.marker_ring import MarkerRing
from palpate.sensors.skin_map import SkinMap
from palpate.sensors.taxel_places import TaxelPlaces

__all__ = ["of_camera", "of_intensity", "of_load_cells", "of_marker_ring", "of_payload", "of_skin_map", "of_taxels"]

Lines = list[tuple[str, str]]


def of_payload(payload: Payload) -> Lines:
    """Each with its standard deviation."""
    spread = np.sqrt(np.diag(payload.covariance))
    weight = float(np.linalg.norm(payload.weight))
    along = payload.weight / weight if weight else np.zeros(3)
    mass_spread = float(np.sqrt(along @ payload.covariance[:3, :3] @ along)) / payload.magnitude
    return [
        ("mass", measured([payload.mass], [mass_spread], "kg")),
        ("gravity", f"({along[0]:.4f}, {along[1]:.4f}, {along[2]:.4f}), its direction in the base"),
        ("centre of mass", measured(1e3 * payload.center_of_mass, 1e3 * spread[6:9], "mm")),
        ("force bias", measured(payload.force_bias, spread[3:6], "N")),
        ("torque bias", measured(payload.torque_bias, spread[9:], "N m")),
        ("residual", f"{1e3 * payload.residual[0]:.3g} mN, {1e3 * payload.residual[1]:.3g} N mm rms"),
    ]


def of_load_cells(cells: LoadCells) -> Lines:
    """Cells, what a reading tells, what it was calibrated with."""
    known = np.isfinite(cells.positions).all(axis=1)
    _, spread, _ = cells.inverse()
    # k cells of S [N/V] share a force F, so that the lengths of their readings add up to F/S or a little more
    sensitivity = 1.0 / np.linalg.norm(cells.matrix[:, :3].reshape(-1, 3, 3), axis=1).sum(axis=0)
    law = cells.indentation
    said = [
        ("cells", f"{cells.cells}, {'places known' if known.all() else f'places of {known.sum()} known'}"),
        ("noise", f"{_range(np.sqrt(np.diag(cells.noise)))} V of a reading, {_mixed(spread)} of the wrench"),
        ("range", _limits(cells.limits)),
        ("sensitivity", f"({_listed(sensitivity)}) N/V a cell along x, y, z, roughly"),
        ("misfit", f"{100 * cells.misfit:.2g} % of a reading"),
        ("drift", f"of the zero: {cells.drift:.2g} standard deviations of a reading"),
        ("samples", f"{cells.samples:,}, {cells.correlation:.3g} of which tell as much as one independent sample"),
    ]
    if law is not None:
        said.append(("soft layer", f"indentation {1e3 * law.depth:.3f} mm at 1 N, growing as F^{law.exponent:.2f}"))
    return said


def of_intensity(intensity: Intensity) -> Lines:
    """Curves, range and how well they hold."""
    curves, which = intensity.curves, intensity.which
    kinds = ", ".join(dict.fromkeys(curve.name for curve in curves))
    sheet = "the same for all cells" if which is None else f"for {' x '.join(map(str, which.shape))} cells"
    top = np.array([curve.saturation for curve in curves])
    lag = np.array([curve.hysteresis for curve in curves])
    unit = intensity.unit
    falling = "; readings fall under load" if curves[0].falling else ""
    said = [
        ("curves", f"{len(curves)}, {kinds}, {sheet}"),
        ("range", f"{_range(np.array([curve.largest for curve in curves]))} N{falling}"),
        ("residual", f"{_range(np.array([curve.residual for curve in curves]))} {unit} rms"),
    ]
    if np.isfinite(top).any():
        said.append(("saturated", f"at {_range(top[np.isfinite(top)])} {unit}"))
    if np.isfinite(lag).any():
        said.append(("hysteresis", f"{_range(100 * lag[np.isfinite(lag)])} % of the span"))
    return said


def of_skin_map(skin: SkinMap) -> Lines:
    """Cells, and how well the sheet lies."""
    surface = skin.surface
    area = f"{1e4 * float(skin.areas.sum()):.1f} cm^2"
    said = [
        ("cells", f"{skin.rows} x {skin.columns}, {area}"),
        ("pitch", f"{1e3 * skin.pitch[0]:.3g} mm between rows, {1e3 * skin.pitch[1]:.3g} mm between columns"),
    ]
    if surface is not None:
        said.append(("spline", f"{surface.points} control points, {'closed' if surface.periodic else 'open'}"))
    if np.isfinite(skin.distance).all():
        said.append(("distance", f"{1e3 * skin.distance[0]:.3f} mm mean, {1e3 * skin.distance[1]:.3f} mm worst"))
    if np.isfinite(skin.strain).all():
        said.append(("strain", f"{100 * skin.strain[0]:.2f} % rms, {100 * skin.strain[1]:.2f} % worst"))
    if skin.overlap.any():
        said.append(("overlap", f"{np.count_nonzero(skin.overlap)} cells lie over or under another one"))
    return said


def of_taxels(places: TaxelPlaces) -> Lines:
    """Taxels, modules, and how well their places are known."""
    there, deviation = places.there, places.deviations()
    count, known = np.count_nonzero(there), np.isfinite(deviation) & there
    absent = f", {len(places) - count} numbers without one" if count < len(places) else ""
    loose = int(np.count_nonzero(there & (places.module < 0)))
    beside = f", and {loose} taxels on none" if loose and places.modules else ""
    facing = np.count_nonzero(np.isfinite(places.normals).all(axis=1) & there)
    said = [
        ("taxels", f"{count:,}{absent}"),
        ("modules", f"{len(np.unique(places.module[there & (places.module >= 0)]))}{beside}"),
        ("normals", "known" if facing == count else f"of {facing:,} known" if facing else "not known"),
    ]
    if places.pokes.any():
        said.append(("touched", f"{np.count_nonzero(places.pokes[there]):,} of {count:,}"))
    if known.any():
        said.append(("deviation", _mean_worst(deviation[known])))
    if np.isfinite(places.relative[there]).any():
        said.append(("relative", f"{_mean_worst(places.relative[there])}, once one rigid motion is taken off"))
    if np.isfinite(places.reach):
        said.append(("reach", f"{1e3 * places.reach:.2f} mm of a response"))
    return said


def _mean_worst(values: Float[np.ndarray, " n"]) -> str:
    return f"{1e3 * float(np.nanmean(values)):.2f} mm mean, {1e3 * float(np.nanmax(values)):.2f} mm worst"


def _limits(limits: Float[np.ndarray, "m 2"]) -> str:
    known = np.asarray(np.isfinite(limits).all(axis=1))
    if not known.any():
        return "not known"
    low, high = limits[known].min(axis=0)[0], limits[known].max(axis=0)[1]
    said = f"{low:.4g} to {high:.4g} V"
    return said if known.all() else f"{said}, of {known.sum()} of {len(known)} channels"


def _mixed(covariance: Float[np.ndarray, "6 6"]) -> str:
    """Force and torque of a wrench's noise."""
    deviation = np.sqrt(np.diag(covariance))
    return f"{1e3 * deviation[:3].max():.2g} mN and {1e3 * deviation[3:].max():.2g} N mm"


def _range(values: Float[np.ndarray, " n"]) -> str:
    low, high = f"{values.min():.3g}", f"{values.max():.3g}"
    return low if low == high else f"{low} to {high}"


def _listed(values: Float[np.ndarray, " n"]) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


def of_marker_ring(ring: MarkerRing) -> Lines:
    """Ring, camera, noise and how well the response holds."""
    response, view = ring.response, ring.view
    outward, along = (1e6 * np.median(ring.noise(), axis=0)).tolist()
    tilt = np.degrees(np.arccos(np.clip(-view.pose.rotation[2, 2], -1.0, 1.0)))
    depth, force = response.largest.tolist()
    rings = f" in {response.rings} rings" if response.rings > 1 else ""
    angle, share = np.degrees(response.spread[0]), 100.0 * response.spread[1]
    return [
        ("ring", f"{len(ring)} {ring.colour.score} markers{rings}, radius {1e3 * ring.radius:.1f} mm outside"),
        ("camera", f"{1e3 * view.pose.translation[2]:.1f} mm above the markers, tilted by {tilt:.1f} deg"),
        ("noise", f"{ring.jitter:.2g} px: {outward:.0f} um outwards, {along:.0f} um along"),
        ("calibrated", f"to {1e3 * depth:.3g} mm, {force:.3g} N{'; shear, too' if response.shears else ''}"),
        ("deviation", f"{angle:.2g} deg and {share:.2g} % of the force beside the noise, on presses left out"),
    ]


def of_camera(camera: Fisheye) -> Lines:
    """Image and focal length."""
    return [
        ("image", f"{camera.width} x {camera.height}"),
        ("focal length", f"{camera.fx:.5g}, {camera.fy:.5g} px/rad"),
    ]
