"""What is public in `palpate`, walked from its source: fields of classes, functions and methods."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@cache
def tree(file: Path) -> ast.Module:
    """Parsed once, as many laws walk over the source."""
    return ast.parse(file.read_text(encoding="utf-8"))


def public() -> Iterator[tuple[str, ast.FunctionDef | ast.AnnAssign]]:
    """Each name, as Class.name where it is of a class, and what it names."""
    for file in sorted((ROOT / "src/palpate").rglob("[a-z]*.py")):
        yield from _of(tree(file), "")


def _of(node: ast.Module | ast.ClassDef, prefix: str) -> Iterator[tuple[str, ast.FunctionDef | ast.AnnAssign]]:
    for each in node.body:
        name = getattr(each, "name", "") or getattr(getattr(each, "target", None), "id", "")
        if not name or name.startswith("_"):
            continue
        if isinstance(each, ast.ClassDef):
            yield from _of(each, f"{name}.")
        elif isinstance(each, ast.FunctionDef) or (prefix and isinstance(each, ast.AnnAssign)):
            yield prefix + name, each
