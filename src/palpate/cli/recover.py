"""Run `palpate recover`: restore a complete file from a recording of `palpate live` that was killed."""

from __future__ import annotations

from palpate.console.console import lines, title
from palpate.console.options import SomeFile
from palpate.errors import InputError
from palpate.live.recover import recover as put_together


def recover(output: SomeFile, /) -> None:
    """Recover a live record after its recorder was killed.

    Put together what `palpate live --record OUTPUT` left when it was killed: OUTPUT.part and OUTPUT.ring.

    Everything that was received is in OUTPUT then; samples that were not answered are readings without contacts.

    Args:
        output: file that was recorded to.

    Raises:
        InputError: its name does not end in .mcap, or nothing can be recovered.
        OSError: the ring cannot be opened.
    """
    if output.suffix.lower() != ".mcap":
        raise InputError("is not a record of `palpate live`.", where=str(output), hint="Name its .mcap file.")
    samples = put_together(output)
    title(f"{output}: recovered")
    lines([("samples", samples)])
