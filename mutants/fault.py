"""A fault, made from what stands in a file, and how a file is written with faults in it, each behind the switch."""

from __future__ import annotations

import ast
import copy
import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

__all__ = ["SOURCE", "Fault", "chosen", "faults_in", "written"]

SOURCE = Path(__file__).resolve().parents[1] / "src"
SWITCH = "_fault"  # as the switch is called in a file with faults
_EITHER = (ast.Lt, ast.GtE), (ast.Gt, ast.LtE), (ast.Eq, ast.NotEq), (ast.Add, ast.Sub), (ast.And, ast.Or)
_OTHER: dict[type, type] = {
    **dict(_EITHER),
    **{other: one for one, other in _EITHER},
    ast.Mult: ast.Add,
    ast.Div: ast.Mult,
}
_KINDS = ast.Compare, ast.BinOp, ast.BoolOp, ast.Constant, ast.Call
_TESTED = {"console": "cli"}  # rooms whose tests are another's
_NAMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "sin": "cos", "cos": "sin"}


@dataclass(frozen=True)
class Fault:
    """An expression inside a function, and what stands in its place when the fault is on; of the same type.

    Attributes:
        file: below src.
        at: which node of the file it is, in the order of `ast.walk`.
        line: of it.
        original: as in the file.
        faulty: takes its place.
    """

    file: str
    at: int
    line: int
    original: str
    faulty: str

    @property
    def tests(self) -> str:
        """The folder of the room's own tests."""
        return tests_of(self.file)

    @property
    def what(self) -> str:
        """Where it is, and what it does."""
        return f"{self.file}:{self.line}: {self.original}  ->  {self.faulty}"


def tests_of(file: str) -> str:
    """Return the folder of the tests of a file's room."""
    package, room, *below = file.split("/")
    if package != "palpate":
        return "tests/lab"
    return f"tests/sensors/{below[0]}" if room == "sensors" else f"tests/{_TESTED.get(room, room)}"


def faults_in(file: str, source: str, most: int | None = None) -> list[Fault]:
    """Return faults that a file can have: operators, comparisons, numbers and names turned into others.

    Args:
        file: below src.
        source: of it.
        most: how many, by chance, the same ones as long as the file stays as it is; None: all.
    """
    tree = ast.parse(source)
    inside = {id(node) for node in _inside_functions(tree)}
    nodes = [(at, node) for at, node in enumerate(ast.walk(tree)) if isinstance(node, _KINDS) and id(node) in inside]
    if most is not None:
        nodes.sort(key=lambda pair: hashlib.sha256(f"{file} {pair[0]}".encode()).digest())
    found = list[Fault]()
    for at, node in nodes:
        if len(found) != most and (other := _other(node)) is not None:
            found.append(Fault(file, at, node.lineno, ast.unparse(node), ast.unparse(other)))
    return found


def chosen(count: int) -> list[Fault]:
    """Return so many faults of both packages by chance, of files by chance."""
    names = [file.relative_to(SOURCE).as_posix() for file in SOURCE.rglob("*/*.py")]
    tested = [name for name in names if (SOURCE.parent / tests_of(name)).is_dir()]
    each, found = max(1, -(-count // len(tested))), list[Fault]()
    for name in sorted(tested, key=lambda name: hashlib.sha256(name.encode()).digest()):
        found += faults_in(name, (SOURCE / name).read_text(encoding="utf-8"), each)
        if len(found) >= count:
            break
    return found[:count]


def _inside_functions(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield all that runs when a function is called; not what runs when the file is imported."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            for statement in node.body:
                yield from ast.walk(statement)


def _other(node: ast.expr) -> ast.expr | None:
    """Return what takes an expression's place; None: it is not of a kind that has faults."""
    made = copy.deepcopy(node)
    if isinstance(made, ast.Compare) and len(made.ops) == 1 and type(made.ops[0]) in _OTHER:
        made.ops = [_OTHER[type(made.ops[0])]()]
    elif isinstance(made, ast.BinOp | ast.BoolOp) and type(made.op) in _OTHER:
        if any(isinstance(each, ast.JoinedStr) or _is_text(each) for each in ast.walk(made)):
            return None
        made.op = _OTHER[type(made.op)]()
    elif isinstance(made, ast.Constant) and type(made.value) is float and made.value:
        made.value *= 2.0
    elif isinstance(made, ast.Call) and isinstance(made.func, ast.Attribute) and made.func.attr in _NAMES:
        made.func.attr = _NAMES[made.func.attr]
    elif isinstance(made, ast.Call) and isinstance(made.func, ast.Name) and made.func.id in _NAMES:
        made.func.id = _NAMES[made.func.id]
    else:
        return None
    return made


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def written(source: str, faults: Sequence[tuple[int, Fault]]) -> str:
    """Return the source of a file with its faults, each under its number."""
    tree = ast.parse(source)
    nodes = list(ast.walk(tree))
    tree = ast.fix_missing_locations(_Inserted({id(nodes[fault.at]): (k, fault) for k, fault in faults}).visit(tree))
    first = 1 + next(k for k, node in enumerate(tree.body) if not _comes_first(node, k))
    tree.body[first - 1 : first - 1] = ast.parse(f"from mutants.switch import switch as {SWITCH}").body
    return ast.unparse(tree)


class _Inserted(ast.NodeTransformer):
    """Put the switch before each place: an expression becomes a choice of two."""

    def __init__(self, places: dict[int, tuple[int, Fault]]) -> None:
        self.places = places

    def visit(self, node: ast.AST) -> ast.AST:
        """Inner places first."""
        here, made = self.places.get(id(node)), self.generic_visit(node)
        if here is None or not isinstance(made, ast.expr):
            return made
        on = ast.parse(f"{SWITCH}() == {here[0]}", mode="eval").body
        return ast.IfExp(on, ast.parse(here[1].faulty, mode="eval").body, made)


def _comes_first(node: ast.stmt, at: int) -> bool:
    """Tell the docstring, and what is imported from the future."""
    if isinstance(node, ast.ImportFrom):
        return node.module == "__future__"
    return at == 0 and isinstance(node, ast.Expr)
