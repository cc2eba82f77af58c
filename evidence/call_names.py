"""Public callables that the walk of calls cannot call, and those that it reaches only in full."""

from __future__ import annotations

__all__ = ["LATER", "UNCALLED"]

UNCALLED = {  # and why
}
LATER = frozenset[str]()
