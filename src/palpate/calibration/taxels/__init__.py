"""Where each taxel of a skin sits, from the wrenches of pokes."""

from palpate.calibration.taxels.calibrate import METHODS, TaxelCalibration, calibrate_taxels
from palpate.calibration.taxels.priors import Priors

__all__ = ["METHODS", "Priors", "TaxelCalibration", "calibrate_taxels"]
