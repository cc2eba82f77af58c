"""A stated fault, and how a file is written with all of its faults in it, each behind the switch."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

__all__ = ["PACKAGE", "Fault", "of", "written"]

PACKAGE = Path(__file__).resolve().parents[1] / "src" / "palpate"
SWITCH = "_fault"  # as the switch is called in a file with faults


@dataclass(frozen=True)
class Fault:
    """An expression or a statement inside a function, and what stands in its place when the fault is on.

    Attributes:
        file: below src/palpate.
        tests: files or folders of the room's own tests.
        what: is wrong then.
        original: as in the file, however it is spaced; found once in the file, or once in `within`.
        faulty: takes its place; in kernels of the same type.
        within: the function to look in, where the original stands in several.
    """

    file: str
    tests: tuple[str, ...]
    what: str
    original: str
    faulty: str
    within: str | None = None

    def place(self, tree: ast.Module) -> ast.AST:
        """The one node of a file that it replaces.

        Raises:
            ValueError: there is none, or there are several.
        """
        wanted = ast.dump(_parsed(self.original)[0])
        found = {id(node): node for node in self._nodes(tree) if ast.dump(node) == wanted}
        if len(found) != 1:
            where = f"{self.file}, {self.within or 'any function'}"
            raise ValueError(f"{where}: {self.original!r} stands there {len(found)} times, not once")
        return next(iter(found.values()))

    def _nodes(self, tree: ast.Module) -> Iterator[ast.AST]:
        """All that runs when a function is called; not what runs when the file is imported."""
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and self.within in (None, node.name):
                for statement in node.body:
                    yield from ast.walk(statement)


def of(file: str, tests: str, *faults: tuple[str, str, str] | tuple[str, str, str, str]) -> list[Fault]:
    """Faults of one file: what is wrong, the original, the faulty, and the function where that is needed."""
    return [Fault(file, tuple(tests.split()), *fault) for fault in faults]


def written(source: str, faults: Sequence[tuple[int, Fault]]) -> str:
    """The source of a file with its faults, each under its number."""
    tree = ast.parse(source)
    places: dict[int, list[tuple[int, Fault]]] = {}
    for number, fault in faults:
        places.setdefault(id(fault.place(tree)), []).append((number, fault))
    tree = ast.fix_missing_locations(_Inserted(places).visit(tree))
    first = 1 + next(k for k, node in enumerate(tree.body) if not _comes_first(node, k))
    tree.body[first - 1 : first - 1] = ast.parse(f"from mutants.switch import switch as {SWITCH}").body
    return ast.unparse(tree)


class _Inserted(ast.NodeTransformer):
    """Puts the switch before each place: an expression becomes a choice of two, a statement a branch."""

    def __init__(self, places: dict[int, list[tuple[int, Fault]]]) -> None:
        self.places = places

    def visit(self, node: ast.AST) -> ast.AST:
        """Inner places first."""
        faults = self.places.get(id(node), [])
        made = self.generic_visit(node)
        for number, fault in faults:
            on = ast.parse(f"{SWITCH}() == {number}", mode="eval").body
            faulty = _parsed(fault.faulty)
            made = ast.IfExp(on, faulty[0], made) if isinstance(made, ast.expr) else ast.If(on, faulty, [made])
        return made


def _parsed(code: str) -> list[ast.AST]:
    """One expression, or statements; what may stand in a function only, too."""
    try:
        return [ast.parse(code.strip(), mode="eval").body]
    except SyntaxError:
        return list(ast.parse(code).body)


def _comes_first(node: ast.stmt, at: int) -> bool:
    """The docstring, and what is imported from the future."""
    if isinstance(node, ast.ImportFrom):
        return node.module == "__future__"
    return at == 0 and isinstance(node, ast.Expr)
