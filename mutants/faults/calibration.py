"""Payload, mounting and clock from logs."""

from mutants.fault import Fault, of

__all__ = ["FAULTS"]

PAYLOAD = "tests/calibration/test_payload.py"
POKED = "tests/calibration/test_poked_taxels.py"
SOLVED = "tests/calibration/test_taxel_solver.py"
FOUND = "tests/calibration/test_find_pokes.py"

FAULTS: list[Fault] = [
    *of(
        "calibration/_payload_fit.py",
        PAYLOAD,
        (
            "the measured force as the torque's regressor",
            "torque_columns(rotations, weight)",
            "np.concatenate([-skew(wrenches[:, :3] - solution[-3:]), 0 * rotations + np.eye(3)], axis=-1)",
            "two_stage",
        ),
        ("residuals of a fit for noise", "np.sqrt(count / free)", "np.sqrt(free / free)"),
        ("samples are set aside too early", "CUTOFF * _spread(residuals, floor)", "2.0 * _spread(residuals, floor)"),
        ("touches are not set aside", "CUTOFF * _spread(residuals, floor)", "1e6 * _spread(residuals, floor)"),
        ("the torque says something of the weight", "instruments[:, 3:, :-6] = 0.0", "pass"),
        (
            "gravity's direction is free though given",
            "solution[0] * direction",
            "solution[0] * np.array([0.0, 0.0, 1.0])",
        ),
    ),
    *of(
        "calibration/payload.py",
        PAYLOAD,
        ("reflections pass", "np.linalg.det(proper) < 0", "np.linalg.det(proper) < -2"),
        ("rows beyond any sensor count", "np.abs(rows) <= LARGEST", "np.isfinite(rows)"),
        ("a far centre is not said", "far <= FAR", "far <= 1e9"),
    ),
    *of(
        "calibration/clock.py",
        "tests/calibration/test_clock.py",
        ("the offset's sign", "self.time - offset", "self.time + offset"),
        (
            "residuals are taken as independent",
            "np.sqrt(max(alike, float(np.sum((weights * along) ** 2))))",
            "np.sqrt(float(np.sum((weights * along) ** 2)))",
        ),
        (
            "touches weigh as much as the rest",
            "1.0 / (1.0 + np.sum(residual**2, axis=1) / (CAUCHY * scale) ** 2)",
            "np.ones(len(residual))",
        ),
        ("an offset at the edge is an answer", "best in (0, len(grid) - 1)", "best < 0"),
        ("what hardly turns is an answer", "not deviation < FLAT", "False"),
        ("the first time of an average for its mean", "times[whole].mean(axis=1)", "times[whole][:, 0]"),
    ),
    *of(
        "calibration/_pose_fit.py",
        "tests/calibration/test_mounting.py",
        (
            "a far touch pulls as hard as any",
            "np.minimum(1.0, USUAL * scale / np.maximum(distances, 1e-12))",
            "np.minimum(1.0, USUAL * scale / np.minimum(distances, 1e-12))",
        ),
        (
            "the scale of distances the wrong way",
            "np.median(distances**2) / MEDIAN",
            "np.median(distances**2) * MEDIAN",
        ),
        ("the turn is taken the other way", "pose.rotation @ initial.rotation.T", "initial.rotation @ pose.rotation.T"),
    ),
    *of(
        "calibration/taxels/nuisances.py",
        POKED,
        ("the shift of a frame the wrong way", "turned + error[:, :3]", "turned - error[:, :3]"),
        ("a bias is added where it was", "pokes.wrench - bias", "pokes.wrench + bias"),
    ),
    *of(
        "calibration/taxels/paper.py",
        POKED,
        ("the link's origin is taken for the sensor's", "torque - np.cross(pokes.origin, force)", "torque"),
        ("doubtful pokes count in full", "pokes.weight[pokes.poke]", "np.ones(len(pokes.poke))"),
    ),
    *of(
        "calibration/taxels/_accumulate.py",
        "tests/calibration/test_taxel_accumulate.py",
        ("the torque is taken for its part beside a unit force", "s * (z * m[0] - x * m[2])", "z * m[0] - x * m[2]"),
        ("a poke without force counts", "not square > 0.0", "square < 0.0"),
        ("a taxel's sums are set and not added to", "sums[j, c] += w * line[c]", "sums[j, c] = w * line[c]"),
    ),
    *of(
        "calibration/taxels/answers.py",
        FOUND,
        ("the rest of a taxel stays as it began", "1.0 - np.exp(-(time[-1] - time[0]) / DRIFT)", "0.0"),
    ),
    *of(
        "calibration/taxels/find.py",
        FOUND,
        (
            "free motion of any pose is taken off",
            "same = there & (_apart(free.mean[about], means[:, None]) <= 1.0)",
            "same = there",
        ),
    ),
    *of(
        "calibration/taxels/_response.py",
        SOLVED,
        ("taxels that were silent tell nothing", "range(told, count)", "range(count, count)"),
        ("every poke presses alike", "total / weight", "0.0"),
        ("answers are not looked at further where they are a little less likely", "best - _NOTHING", "best - 1.0"),
        ("no place lies between points of the grid", "(2.0 / (side - 1)) ** 2 / 12.0", "0.0"),
    ),
    *of(
        "calibration/taxels/solve.py",
        SOLVED,
        ("units do not see what they have in common", "told[:, -1] - told[:, :-1] @ common", "told[:, -1]"),
    ),
    *of(
        "calibration/taxels/solve.py",
        POKED,
        (
            "contacts about a taxel err by as much wherever they are",
            "root @ linear.by_point[rows] @ axes @ seen.covariance[rows]",
            "1e-6 * root @ linear.by_point[rows] @ axes",
        ),
        (
            "derivatives hold what a contact is off by",
            "predicted(replace(pokes, wrench=pokes.wrench - noise), points, nuisances)",
            "predicted(replace(pokes, wrench=pokes.wrench - noise), points + 1e-3 * told[..., 0], nuisances)",
        ),
        (
            "bias and cross-talk pass for friction",
            "_twist(force, residual, spread, seen.found & (pokes.weight > 0))",
            "_twist(force, pokes.wrench[:, 3:], spread, seen.found & (pokes.weight > 0))",
        ),
        ("weights that fall waste nothing", "mean - 2.0 * varied / (TAIL + 3.0)", "mean"),
    ),
    *of(
        "calibration/taxels/plan.py",
        POKED,
        (
            "a plan looks at the taxels that are known best",
            "(traces / traces[j]) ** KEEN",
            "(traces / traces[j]) ** -KEEN",
        ),
    ),
    *of(
        "sensors/taxel_modules.py",
        POKED,
        (
            "a bent module is as long as seen from above",
            "flat + (flat * pull).sum(axis=1, keepdims=True) * pull / 6.0",
            "flat",
        ),
    ),
    *of(
        "calibration/taxels/calibrate.py",
        SOLVED,
        (
            "a rigid motion is taken off once",
            "2.0 * np.einsum('kia,kia->k', basis, own)",
            "np.einsum('kia,kia->k', basis, own)",
        ),
    ),
    *of(
        "calibration/taxels/response.py",
        POKED,
        ("pokes lie on the chord between taxels", "units.surface.project(points)[0]", "points"),
    ),
    *of(
        "calibration/marker_ring/response.py",
        "tests/calibration/test_ring_response.py",
        ("misfits of all rings are mixed", "ring == row // 2", "ring >= 0"),
        ("a light press says what friction is", "presses.force >= np.median(presses.force)", "presses.force > 0.0"),
        (
            "another unit's friction is forgotten",
            "before.usual, before.grip, before.dragged",
            "before.usual, 0.0, before.dragged",
        ),
        (
            "another unit's kinds are forgotten",
            "before.usual, before.grip, before.dragged",
            "before.usual, before.grip, np.zeros(3)",
        ),
        ("presses always come in two kinds", "two - one < np.log(len(share))", "two - one < -np.inf"),
        (
            "shear of 0 is believed",
            "np.maximum(np.sqrt(square @ each / np.maximum(each.sum(axis=0), 1e-300)), _PLAIN)",
            "np.maximum(np.sqrt(square @ each / np.maximum(each.sum(axis=0), 1e-300)), 1e-9)",
        ),
        ("shares stay as they were taken for", "weights = each.mean(axis=0)", "pass"),
        (
            "the evidence does not know how far a prior reaches",
            "spread = np.sum(np.log(precision)) - 2.0 * np.sum(np.log(np.diag(factor[0])))",
            "spread = 0.0",
        ),
    ),
]
