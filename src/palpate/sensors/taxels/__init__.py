"""Estimate contacts on a skin of taxels: a flexible sheet on a curved link, or taxels anywhere on a body."""

from palpate.sensors.taxels.calibrate import identify_intensity
from palpate.sensors.taxels.estimator import TaxelEstimator
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.place_formats import read_taxel_places

__all__ = ["TaxelBody", "TaxelEstimator", "identify_intensity", "read_taxel_places"]
