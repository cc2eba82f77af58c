"""`python -m tests.size [COMMIT]`: lines of code by room of `palpate` and `palpate_lab`, without comments, docstrings.

With a commit, its lines stand beside those of this checkout.
"""

import ast
import io
import subprocess
import sys
import tarfile
import tokenize
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = "src/palpate", "src/palpate_lab"
NO_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}


def lines_of_code(text: str) -> int:
    """Count the lines of a module that hold code."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docstrings = set[int]()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, documented) and ast.get_docstring(node, clean=False) is not None:
            docstrings |= set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    code = {line for token in tokens if token.type not in NO_CODE for line in range(token.start[0], token.end[0] + 1)}
    return len(code - docstrings)


def rooms(commit: str | None = None) -> Counter[str]:
    """Count the lines of code by room of this checkout, or of a commit."""
    counts = Counter[str]()
    for path, text in _files(commit):
        _, package, *parts = Path(path).parts
        room = parts[0] if len(parts) > 1 else "(top)"
        counts[room if package == "palpate" else f"lab {room}"] += lines_of_code(text)
    return counts


def _files(commit: str | None) -> list[tuple[str, str]]:
    if commit is None:
        return [
            (str(path.relative_to(ROOT)), path.read_text(encoding="utf-8"))
            for package in PACKAGES
            for path in (ROOT / package).rglob("*.py")
        ]
    packed = subprocess.run(["git", "archive", commit, "src"], cwd=ROOT, capture_output=True, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(packed)) as files:
        found = [(each.name, files.extractfile(each)) for each in files if each.name.endswith(".py")]
        return [(name, file.read().decode()) for name, file in found if file is not None]


def main() -> None:
    """Print the table."""
    commit = next((each for each in sys.argv[1:] if each), None)
    here, there = rooms(), rooms(commit) if commit else None
    for room in sorted(here | (there or {})):
        print(_row(room, here[room], None if there is None else there[room]))
    for name, inside in (("palpate", _ours), ("palpate_lab", lambda room: not _ours(room))):
        both = [
            None if counts is None else sum(counts[room] for room in counts if inside(room)) for counts in (here, there)
        ]
        print(_row(name, both[0] or 0, both[1]))


def _ours(room: str) -> bool:
    return not room.startswith("lab ")


def _row(room: str, here: int, there: int | None) -> str:
    return f"{room:12} {here:7,}" + ("" if there is None else f"   {there:7,} there   {here - there:+,}")


if __name__ == "__main__":
    main()
