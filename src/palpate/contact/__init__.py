"""Compute contacts from readings and a surface; `palpate.contact.locate` is a module, `palpate.locate` a function."""

from typing import TYPE_CHECKING

from palpate.calls import later

if TYPE_CHECKING:
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

__getattr__ = later(
    __name__,
    {
        "contacts": "Contacts",
        "estimate": "ROW ContactEstimate Status",
        "locate": "Candidates Locator",
        "wrench_estimator": "WrenchEstimator",
    },
)
