"""What numba has compiled in this process, of the entries of all kernels that are loaded."""

from palpate.surfaces import _jit


def compilations() -> int:
    """Return how many signatures numba has machine code for; none where the extension module has everything."""
    return sum(len(entry.dispatcher.signatures) for entry in _jit.ENTRIES.values() if "dispatcher" in vars(entry))
