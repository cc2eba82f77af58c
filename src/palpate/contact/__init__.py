"""Compute contacts from readings and a surface; `palpate.contact.locate` is a module, `palpate.locate` a function."""

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, ContactEstimate, Status
from palpate.contact.locate import Candidates, Locator
from palpate.contact.wrench_estimator import WrenchEstimator

__all__ = [
    "ROW",
    "Candidates",
    "ContactEstimate",
    "Contacts",
    "Locator",
    "Status",
    "WrenchEstimator",
]
