"""From readings and a surface to contacts."""

from palpate.contact.estimate import ROW, ContactEstimate, Status
from palpate.contact.estimator import Estimator
from palpate.contact.locate import METHODS, Candidates, Locator, locate

__all__ = ["METHODS", "ROW", "Candidates", "ContactEstimate", "Estimator", "Locator", "Status", "locate"]
