"""A fault, made from what stands in a file, and how a file is written with faults in it, each behind the switch."""

from __future__ import annotations

import ast
import copy
import hashlib
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
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
_EXPRESSIONS = ast.Compare, ast.BinOp, ast.BoolOp, ast.UnaryOp, ast.Constant, ast.Call, ast.Subscript
_STATEMENTS = ast.Expr, ast.Assign, ast.AugAssign
_COMPILED = "surfaces._jit"  # whoever imports it has compiled functions, whose types a fault must not change
DROPPED = "pass"
MOST = 3  # faults of a file
_TESTED = {"console": "cli"}  # rooms whose tests are another's
_NAMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "sin": "cos", "cos": "sin"}


@dataclass(frozen=True)
class Fault:
    """An expression or a statement inside a function, and what stands in its place when the fault is on.

    Attributes:
        file: below src.
        at: which node of the file it is, in the order of `ast.walk`.
        line: of it.
        original: as in the file.
        faulty: takes its place; of an expression in a compiled file, of the same type.
        tests: files or folders, with blanks between them.
    """

    file: str
    at: int
    line: int
    original: str
    faulty: str
    tests: str

    @property
    def diff(self) -> str:
        """What it does in which file."""
        return f"{self.file}: {self.original}  ->  {self.faulty}"

    @property
    def what(self) -> str:
        """Where it is, and what it does."""
        return f"{self.file}:{self.line}: {self.original}  ->  {self.faulty}"


def tests_of(file: str) -> str:
    """Return the folder of the tests of a file's room; of a sensor, that of the table which all sensors pass, too."""
    _, room, *below = file.split("/")
    if room == "sensors" and len(below) > 1:
        return f"tests/sensors/{below[0]} tests/conformance"
    return f"tests/{_TESTED.get(room, room)}"


def faults_in(file: str, source: str, most: int | None = None, seed: int = 0) -> list[Fault]:
    """Return faults that a file can have: comparisons, signs, numbers, indices, keys, arguments, dropped statements.

    Args:
        file: below src.
        source: of it.
        most: how many, by chance, the same ones as long as seed and file stay as they are; None: all.
        seed: of what is chosen.
    """
    tree = ast.parse(source)
    compiled = _COMPILED in source
    inside = {id(node) for node in _inside_functions(tree)}
    nodes = [(at, node) for at, node in enumerate(ast.walk(tree)) if id(node) in inside]
    if most is not None:
        nodes.sort(key=lambda pair: hashlib.sha256(f"{seed} {file} {pair[0]}".encode()).digest())
    found = list[Fault]()
    for at, node in nodes:
        if len(found) == most:
            break
        if isinstance(node, _STATEMENTS) and _can_go(node):
            found.append(Fault(file, at, node.lineno, ast.unparse(node), DROPPED, tests_of(file)))
        elif isinstance(node, _EXPRESSIONS) and (other := _other(node, compiled=compiled)) is not None:
            found.append(Fault(file, at, node.lineno, ast.unparse(node), ast.unparse(other), tests_of(file)))
    return found


def chosen(count: int, seed: int = 0) -> list[Fault]:
    """Return so many faults of the package by chance, of files by chance, at most three of each; 0: those of a kind."""
    if not count:
        return list(_of_kinds())
    names = [file.relative_to(SOURCE).as_posix() for file in (SOURCE / "palpate").rglob("*.py")]
    tested = [name for name in names if (SOURCE.parent / tests_of(name).split()[0]).is_dir()]
    each, found = min(MOST, max(1, -(-count // len(tested)))), list[Fault]()
    for name in sorted(tested, key=lambda name: hashlib.sha256(f"{seed} {name}".encode()).digest()):
        found += faults_in(name, (SOURCE / name).read_text(encoding="utf-8"), each, seed)
        if len(found) >= count:
            break
    return found[:count]


def _of_kinds() -> Iterator[Fault]:
    """Yield the faults of `kinds.toml`, with the tests of their law."""
    for law in tomllib.loads(Path(__file__).with_name("kinds.toml").read_text(encoding="utf-8"))["law"]:
        for diff in (each for pair in law["kinds"].values() for each in pair):
            file = diff.partition(":")[0]
            made = [each for each in faults_in(file, (SOURCE / file).read_text(encoding="utf-8")) if each.diff == diff]
            if not made:
                raise ValueError(f"kinds.toml: no such fault can be made: {diff}")
            yield replace(made[0], tests=law["tests"])


def _inside_functions(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield all that runs when a function is called; not what runs when the file is imported."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            for statement in node.body:
                yield from ast.walk(statement)


def _can_go(node: ast.stmt) -> bool:
    """Return whether a statement can be dropped and leaves no name without a value."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Call)
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AugAssign) else []
    named = isinstance(node, ast.AugAssign)
    return all(named or isinstance(each, ast.Attribute | ast.Subscript) for each in targets)


def _other(node: ast.expr, *, compiled: bool) -> ast.expr | None:
    """Return what takes an expression's place; None: it is not of a kind that has faults."""
    made = copy.deepcopy(node)
    if isinstance(made, ast.Compare) and len(made.ops) == 1 and type(made.ops[0]) in _OTHER:
        made.ops = [_OTHER[type(made.ops[0])]()]
    elif isinstance(made, ast.BinOp | ast.BoolOp) and type(made.op) in _OTHER:
        if any(isinstance(each, ast.JoinedStr) or _is_text(each) for each in ast.walk(made)):
            return None
        made.op = _OTHER[type(made.op)]()
    elif isinstance(made, ast.UnaryOp) and isinstance(made.op, ast.USub):
        return made.operand
    elif isinstance(made, ast.Constant) and type(made.value) is float and made.value:
        made.value *= 2.0
    elif isinstance(made, ast.Call):
        return _called(made, compiled=compiled)
    elif isinstance(made, ast.Subscript) and isinstance(made.ctx, ast.Load) and not compiled:
        return _indexed(made)
    else:
        return None
    return made


def _called(made: ast.Call, *, compiled: bool) -> ast.expr | None:
    """Return a call of another function, with its first arguments exchanged, or without its last named one."""
    if isinstance(made.func, ast.Attribute) and made.func.attr in _NAMES:
        made.func.attr = _NAMES[made.func.attr]
    elif isinstance(made.func, ast.Name) and made.func.id in _NAMES:
        made.func.id = _NAMES[made.func.id]
    elif compiled:
        return None
    elif made.keywords and made.keywords[-1].arg is not None:
        made.keywords.pop()
    elif len(made.args) > 1 and not any(isinstance(each, ast.Starred) for each in made.args[:2]):
        made.args[:2] = made.args[1::-1]
    else:
        return None
    return made


def _indexed(made: ast.Subscript) -> ast.expr | None:
    """Return the next item, or that of another key."""
    if not isinstance(made.slice, ast.Constant) or type(made.slice.value) not in (int, str):
        return None
    made.slice.value = made.slice.value + (1 if type(made.slice.value) is int else "_")
    return made


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def written(source: str, faults: Sequence[tuple[int, Fault]]) -> str:
    """Return the source of a file with its faults, each under its number."""
    tree = ast.parse(source)
    nodes = list(ast.walk(tree))
    tree = ast.fix_missing_locations(_Inserted({id(nodes[fault.at]): (k, fault) for k, fault in faults}).visit(tree))
    first = 1 + next(k for k, node in enumerate(tree.body) if not _comes_first(node, k))
    module = "compiled_switch" if _COMPILED in source else "switch"
    tree.body[first - 1 : first - 1] = ast.parse(f"from mutants.{module} import switch as {SWITCH}").body
    return ast.unparse(tree)


class _Inserted(ast.NodeTransformer):
    """Put the switch before each place: an expression becomes a choice of two, a statement may be passed over."""

    def __init__(self, places: dict[int, tuple[int, Fault]]) -> None:
        self.places = places

    def visit(self, node: ast.AST) -> ast.AST:
        """Inner places first."""
        here, made = self.places.get(id(node)), self.generic_visit(node)
        if here is None:
            return made
        on = ast.parse(f"{SWITCH}({here[0]})", mode="eval").body
        if isinstance(made, ast.stmt):
            return ast.If(on, [ast.Pass()], [made])
        if not isinstance(made, ast.expr):
            return made
        return ast.IfExp(on, ast.parse(here[1].faulty, mode="eval").body, made)


def _comes_first(node: ast.stmt, at: int) -> bool:
    """Tell the docstring, and what is imported from the future."""
    if isinstance(node, ast.ImportFrom):
        return node.module == "__future__"
    return at == 0 and isinstance(node, ast.Expr)
