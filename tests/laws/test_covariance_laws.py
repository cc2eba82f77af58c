"""Law 3: whatever states a covariance states that of its errors, with everything correlated, unequal and moving.

The tests of the law stand in their rooms, on the dice of `tests.support.dice`. Here is the list of all that states a
covariance, walked from the source, with the file that holds it against dice or against an independent computation.
"""

import ast
import re
from collections.abc import Iterator

import numpy as np

from tests.support.dice import agree, even, mixed
from tests.support.walked import ROOT, public

HELD = {
    "calibration/test_fit_covariances.py": "mean_touches TouchError.carried Mounting.position_covariance courses_of "
    "WalkFit.covariance pseudo_inverse",
    "calibration/test_mounting.py": "Mounting.covariance",
    "calibration/test_servo.py": "ServoMotion.spread",
    "contact/test_contact_covariances.py": "ellipse largest_deviation ContactShape.explains",
    "contact/test_events.py": "Events.covariance",
    "contact/test_uncertainty.py": "ContactEstimate.covariance Contacts.covariance locate",
    "contact/test_estimator.py": "WrenchEstimator.contact_wrenches Wrenches.covariance",
    "contact/test_soft_layer.py": "Indentation.covariance",
    "files/test_robot_motion.py": "JointSamples.covariance RobotMotion.covariance",
    "sensors/force_torque/test_payload.py": "Payload.covariance",
    "sensors/force_torque/test_payload_covariances.py": "Compensation.place WrenchSensor.place Compensation.as_wrench "
    "Compensation.window_noise FollowedSensor.window_noise FollowedSensor.as_wrench",
    "sensors/fused/test_fused.py": "Fused.covariance FusedFrames.spread within_cones",
    "sensors/load_cells/test_cell_covariances.py": "LoadCellArray.place LoadCellArray.as_wrench with_gains "
    "LoadCellArray.window_noise Explanations.covariances LoadCells.wrenches LoadCells.calibration_covariance "
    "LoadCells.inverse LoadCells.complete Gains.covariance Weights.spread",
    "sensors/load_cells/test_load_cells_calibration.py": "LoadCells.covariance",
    "sensors/taxels/test_taxel_covariances.py": "Curve.covariance",
    "sensors/taxels/test_intensity.py": "identify_resistive",
    "sensors/taxels/test_taxels_anywhere.py": "TaxelBody.covariance TaxelPlaces.covariance",
    "sensors/taxels/test_taxel_errors.py": "TaxelPlaces.deviations",
    "sensors/taxels/test_taxel_solver.py": "spreads seen_among PokePlaces.covariance",
    "sensors/taxels/test_poked_taxels.py": "PlacesSolution.covariance Before.covariance after_calibration known_after",
    "sensors/taxels/test_registration.py": "Registration.covariance Registration.spread",
    "setup/test_robot_pipeline.py": "widened",
    "signals/test_signal_covariances.py": "Payload.compensate Payload.load_jacobian Payload.load_covariance "
    "Imu.covariance Payload.joint_covariance square_root",
    "signals/test_vibration.py": "Vibration.stream",
    "signals/test_zero_filter.py": "ZeroState.covariance smoothed FilterStep.covariance ZeroFilter.predicted "
    "ZeroFilter.known_of ZeroFilter.expected ZeroFilter.spread ZeroFilter.spread_by",
    "spatial/test_uncertain.py": "noise_covariance inverse_pose_covariance",
    "spatial/test_wrench.py": "Wrench.covariance Wrench.transformed",
}
GIVEN = {  # what only hands on a covariance that it was given, or reads it from a file
    *("Locator.with_noise", "Located.covariance", "covariance_matrix", "Link.mount_covariance"),
    *("RigSurface.pose_covariance", "DownsampledRun.covariance", "ShownContact.covariance", "RingResponse.spread"),
}


def stated() -> Iterator[str]:
    """Every public field, property, function and method of `palpate` that holds or returns a covariance."""
    for name, node in public():
        text = (ast.get_docstring(node) or "") if isinstance(node, ast.FunctionDef) else ""
        first, returned = text.split("\n\n")[0], text.partition("Returns:")[2].partition("Raises:")[0]
        told = (first if re.match("Return|Yield", first) else "") + returned
        if "ovariance" in name + told or (isinstance(node, ast.AnnAssign) and name.endswith(".spread")):
            yield name


def test_whatever_states_a_covariance_has_its_test() -> None:
    names = " ".join(HELD.values()).split()
    assert len(names) == len(set(names))
    assert set(stated()) == {*names, *GIVEN}
    assert all((ROOT / "tests" / file).is_file() for file in HELD)


def test_throws_of_dice_are_what_they_are_called() -> None:
    own = mixed(np.array([1.0, 1e-3, 5.0]), 7)
    throws = even(own, 1.0)
    np.testing.assert_allclose(throws.mean(axis=0), 0.0, atol=1e-12)
    agree(throws.T @ throws / len(throws), own, 1e-9)
    assert np.abs(np.corrcoef(throws.T)[np.triu_indices(3, 1)]).min() > 0.2
