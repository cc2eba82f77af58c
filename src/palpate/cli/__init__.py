"""The commands: loops and messages, no mathematics."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from palpate.errors import PalpateError

__all__ = ["main"]

FAILED, USAGE, INTERRUPTED = 1, 2, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Returns:
        0; 1 when the input cannot be used (one sentence on stderr); 2 for a wrong call; 130 after Ctrl-C.
    """
    from palpate.cli.app import run  # here: `import palpate.cli` stays free of what commands need

    try:
        run(argv)
    except PalpateError as problem:
        print(f"palpate: {problem}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print("palpate: interrupted; no file is half written", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output (head, less) has left
        sys.stderr.close()
        return 0
    except SystemExit as leaving:  # the parser's: 0 after --help
        return leaving.code if isinstance(leaving.code, int) else USAGE
    return 0
