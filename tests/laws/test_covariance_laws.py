"""Law 3: whatever states a covariance states that of its errors, with everything correlated, unequal and moving.

The tests of the law stand in their rooms, on the dice of `tests.support.dice`. Here is the list of all that states a
covariance, walked from the source, with the test that holds it against dice or against an independent computation.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tests.support.dice import agree, even, mixed

ROOT = Path(__file__).resolve().parents[2]
FORCE_TORQUE, CELLS = "sensors/force_torque/test_payload_covariances.py", "sensors/load_cells/test_cell_covariances.py"
TAXELS, POKES = "sensors/taxels/test_taxel_covariances.py", "sensors/taxels/test_poked_taxels.py"
HELD = {  # test: what it holds
    "calibration/test_covariances.py::test_means_of_touches": "mean_touches",
    "calibration/test_covariances.py::test_a_drift_is_carried": "TouchError.carried",
    "calibration/test_covariances.py::test_a_surface_s_origin": "Mounting.position_covariance",
    "calibration/test_covariances.py::test_courses_are_as_sure": "courses_of WalkFit.covariance",
    "calibration/test_covariances.py::test_an_information_is_inverted": "pseudo_inverse",
    "calibration/test_mounting.py::test_errors_are_as_large_as_the_covariance_says": "Mounting.covariance",
    "calibration/test_servo.py::test_deviations_hold": "ServoMotion.spread",
    "contact/test_covariances.py::test_an_ellipse_has_the_covariance": "ellipse largest_deviation",
    "contact/test_covariances.py::test_a_change_of_the_zero": "ContactShape.explains",
    "contact/test_events.py::test_the_place_is_as_sure_as_its_sample": "Events.covariance",
    "contact/test_uncertainty.py::test_a_place_is_as_sure": "ContactEstimate.covariance Contacts.covariance locate",
    "contact/test_estimator.py::test_payload_and_mounting_add": "WrenchEstimator.contact_wrenches Wrenches.covariance",
    "contact/test_soft_layer.py::test_the_covariance_is_that_of_differences": "Indentation.covariance",
    "files/test_robot_motion.py::test_deviations_of_encoders": "JointSamples.covariance RobotMotion.covariance",
    f"{FORCE_TORQUE}::test_a_wrench_on_a_moving_sensor": "Compensation.place WrenchSensor.place",
    f"{FORCE_TORQUE}::test_a_window_s_mean": "Compensation.window_noise FollowedSensor.window_noise",
    f"{FORCE_TORQUE}::test_a_wrench_of_changes": "Compensation.as_wrench FollowedSensor.as_wrench",
    "sensors/fused/test_fused.py::test_forces_are_those_of_dense_conditioning": "Fused.covariance within_cones",
    "sensors/fused/test_fused.py::test_frames_are_fused_as_each_alone": "FusedFrames.spread",
    f"{CELLS}::test_a_wrench_in_the_surface": "LoadCellArray.place Explanations.covariances",
    f"{CELLS}::test_a_change_of_voltages": "LoadCellArray.as_wrench LoadCellArray.window_noise",
    f"{CELLS}::test_a_wrench_is_as_sure": "LoadCells.wrenches LoadCells.calibration_covariance LoadCells.inverse",
    f"{CELLS}::test_what_cells_of_one_axis": "LoadCells.complete unmeasured_covariance",
    f"{CELLS}::test_the_gains_of_a_plate": "with_gains Gains.covariance Weights.spread",
    "sensors/load_cells/test_load_cells_calibration.py::test_the_true_matrix_lies": "LoadCells.covariance",
    f"{TAXELS}::test_a_force_by_a_curve": "Curve.covariance",
    "sensors/taxels/test_intensity.py::test_a_divider_is_as_sure": "identify_resistive",
    "sensors/taxels/test_taxels_anywhere.py::test_a_contact_carries": "TaxelBody.covariance TaxelPlaces.covariance",
    "sensors/taxels/test_taxel_errors.py::test_half_axes_are": "TaxelPlaces.deviations",
    "sensors/taxels/test_taxel_solver.py::test_spreads_are_those": "spreads seen_among PokePlaces.covariance",
    f"{POKES}::test_the_covariance_holds_pokes": "PlacesSolution.covariance Before.covariance",
    f"{POKES}::test_a_planned_poke_shrinks": "after_calibration known_after",
    "sensors/taxels/test_registration.py::test_the_pose_is_found": "Registration.covariance Registration.spread",
    "setup/test_robot_pipeline.py::test_widened_covariances": "widened",
    "signals/test_covariances.py::test_a_payload_is_as_sure": "Payload.compensate Payload.load_jacobian",
    "signals/test_covariances.py::test_a_payload_with_an_imu": "Payload.load_covariance Payload.joint_covariance",
    "signals/test_covariances.py::test_the_forces_of_an_imu": "Imu.covariance",
    "signals/test_covariances.py::test_a_root_has_the_rank": "square_root",
    "sensors/force_torque/test_payload.py::test_covariance_holds": "Payload.covariance",
    "signals/test_vibration.py::test_a_tone_has_half_its_square": "Vibration.stream",
    "signals/test_zero_filter.py::test_filter_and_smoother_are_the_posterior": "ZeroState.covariance smoothed "
    "FilterStep.covariance ZeroFilter.predicted ZeroFilter.known_of ZeroFilter.expected ZeroFilter.spread",
    "signals/test_zero_filter.py::test_regressors_act": "ZeroFilter.spread_by",
    "spatial/test_uncertain.py::test_six_deviations": "noise_covariance",
    "spatial/test_uncertain.py::test_the_inverse_of_an_uncertain_pose": "inverse_pose_covariance",
    "spatial/test_wrench.py::test_covariance_goes": "Wrench.covariance Wrench.transformed",
}
GIVEN = {  # what only hands on a covariance that it was given, or reads it from a file
    *("Locator.with_noise", "Located.covariance", "covariance_matrix", "Link.mount_covariance"),
    *("RigSurface.pose_covariance", "DownsampledRun.covariance", "ShownContact.covariance", "RingResponse.spread"),
}


def stated() -> Iterator[str]:
    """Every public field, property, function and method of `palpate` that holds or returns a covariance."""
    for file in sorted((ROOT / "src/palpate").rglob("[a-z]*.py")):
        yield from _of(ast.parse(file.read_text(encoding="utf-8")), "")


def _of(node: ast.Module | ast.ClassDef, prefix: str) -> Iterator[str]:
    for each in node.body:
        name = getattr(each, "name", "")
        if isinstance(each, ast.ClassDef) and not name.startswith("_"):
            yield from _of(each, f"{name}.")
        elif isinstance(each, ast.AnnAssign) and isinstance(node, ast.ClassDef):
            field = getattr(each.target, "id", "")
            if re.search("covariance|^spread$", field):
                yield prefix + field
        elif isinstance(each, ast.FunctionDef) and not name.startswith("_"):
            text = ast.get_docstring(each) or ""
            first = text.split("\n\n")[0]
            told = first if re.match("Return|Yield", first) else ""
            told += text.partition("Returns:")[2].partition("Raises:")[0]
            if "ovariance" in name + told:
                yield prefix + name


def test_whatever_states_a_covariance_has_its_test() -> None:
    names = " ".join(HELD.values()).split()
    assert len(names) == len(set(names))
    assert set(stated()) == {*names, *GIVEN}
    for test in HELD:
        file, _, name = test.partition("::")
        assert f"def {name}" in (ROOT / "tests" / file).read_text(encoding="utf-8"), test


def test_throws_of_dice_are_what_they_are_called() -> None:
    own = mixed(np.array([1.0, 1e-3, 5.0]), 7)
    throws = even(own, 1.0)
    np.testing.assert_allclose(throws.mean(axis=0), 0.0, atol=1e-12)
    agree(throws.T @ throws / len(throws), own, 1e-9)
    assert np.abs(np.corrcoef(throws.T)[np.triu_indices(3, 1)]).min() > 0.2
