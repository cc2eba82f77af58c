"""Find the place of each taxel of a skin from the wrenches of pokes."""

from palpate.sensors.taxels.poking.calibrate import TaxelCalibration, calibrate_taxels
from palpate.sensors.taxels.poking.priors import Priors

__all__ = ["Priors", "TaxelCalibration", "calibrate_taxels"]
