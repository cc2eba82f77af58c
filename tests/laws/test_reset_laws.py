"""Law 2: after `reset` an object is as a new one, in all that it answers and in all that it remembers.

Whatever has a `reset` is found in the source, and each of its statements is left out in turn: a scene must notice.
"""

import ast
import copy
import importlib
import inspect
import sys
import textwrap
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

import palpate
from palpate.viewer.live import LivePage, StreamFigures
from tests.support.resets import SCENES, Scene
from tests.support.state import ROOM, parts, remembered

SOURCE = Path(palpate.__file__).parent
NEEDLESS = ("DriftTracker.reset: self._taken",)  # the sensor's count, which a reset does not change
STARTED = ("controller", "new controller", "motions")  # whose reset needs a first reading
STARTS = ("AlignController", "Supervisor", "ServoModel", "MotionBank")  # what `start` begins anew


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Short logs are thinned as long ones are."""
    monkeypatch.setattr("palpate.sensors.load_cells.array.KEPT", 20)
    monkeypatch.setattr("palpate.sensors.taxels.watch.KEPT", 16)


def _spoil(made: Any) -> None:
    """Fill its room to work in with what is no answer."""
    for part in parts(made):
        for name in ROOM:
            kind, _, field = name.partition(".")
            values = getattr(part, field, None) if kind == type(part).__name__ else None
            for each in values if isinstance(values, tuple) else (values,):
                if isinstance(each, np.ndarray) and each.flags.writeable:
                    each[...] = np.nan if each.dtype == np.float64 else 77


@cache
def _made(scene: Scene, use: Callable[[Any], object] | None) -> Any:
    """An object in the middle of something; None: a new one after a reset."""
    made = scene.make()
    (use or scene.reset)(made)
    return made


def _copied(made: Any) -> Any:
    return copy.deepcopy(made, {id(each): each for each in sys.modules.values()})


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_reset_is_a_new_object(scene: Scene) -> None:
    fresh = _copied(_made(scene, None))
    assert scene.name in STARTED or not remembered(scene.make(), fresh)
    known = scene.answers(fresh)
    for use in scene.uses:
        used = _copied(_made(scene, use))
        scene.reset(used)
        assert not remembered(used, _made(scene, None))
        _spoil(used)
        assert not remembered(scene.answers(used), known)
        assert not remembered(used, fresh)


def _resets() -> Iterator[tuple[type, str]]:
    """Class and method of every reset in the source, but for those of interfaces."""
    for path in sorted(SOURCE.rglob("*.py")):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef) and "Protocol" not in map(ast.unparse, node.bases):
                module = ".".join(path.relative_to(SOURCE.parent).with_suffix("").parts)
                for each in node.body:
                    name = each.name if isinstance(each, ast.FunctionDef) else ""
                    if name == "reset" or (name == "start" and node.name in STARTS):
                        yield getattr(importlib.import_module(module), node.name), name


def _steps(tree: ast.AST) -> list[ast.AST]:
    """What a method sets or calls, one after the other, without its docstring."""
    kinds = ast.Attribute | ast.Subscript
    stored = (isinstance(each, kinds) and isinstance(each.ctx, ast.Store) for each in ast.walk(tree))
    found = (each for each, keep in zip(ast.walk(tree), stored, strict=True) if keep or isinstance(each, ast.Expr))
    return [each for each in found if not isinstance(getattr(each, "value", None), ast.Constant)]


class _Without(ast.NodeTransformer):
    """Leave out one of the steps."""

    def __init__(self, node: ast.AST) -> None:
        self.node = node

    def visit(self, node: ast.AST) -> ast.AST:
        if node is self.node:
            return ast.Pass() if isinstance(node, ast.Expr) else ast.Name("_", ast.Store())
        return self.generic_visit(node)


def _mutants(kind: type, method: str) -> Iterator[tuple[str, Callable[..., None]]]:
    """Yield the method without each of its steps."""
    source = textwrap.dedent(inspect.getsource(getattr(kind, method)))
    for k in range(len(_steps(ast.parse(source)))):
        tree = ast.parse(source)
        step = _steps(tree)[k]
        said = f"{kind.__name__}.{method}: {ast.unparse(step)}"
        outer = ast.parse(f"def outer(__class__):\n    return {method}").body[0]  # `super()` looks for that name
        assert isinstance(outer, ast.FunctionDef)
        outer.body.insert(0, _Without(step).visit(tree).body[0])
        names = dict(vars(inspect.getmodule(kind)))
        exec(compile(ast.fix_missing_locations(ast.Module([outer], [])), said, "exec"), names)
        yield said, names["outer"](kind)


@cache
def _classes(scene: Scene) -> frozenset[type]:
    """Of all that a used object has."""
    return frozenset(base for part in parts(_made(scene, scene.uses[0])) for base in type(part).__mro__)


def _noticed(scene: Scene, use: Callable[[Any], object], kind: type, method: str, mutant: Any) -> bool:
    used = _copied(_made(scene, use))
    with mock.patch.object(kind, method, mutant):
        scene.reset(used)
    return bool(remembered(used, _made(scene, None))) or (
        scene.name == "vibration" and used.notes() != scene.make().notes()
    )


@pytest.mark.parametrize(("kind", "method"), list(_resets()), ids=lambda value: getattr(value, "__name__", value))
def test_each_step_of_a_reset_is_missed_where_it_is_left_out(kind: type, method: str) -> None:
    ways = [(scene, use) for scene in SCENES if kind in _classes(scene) for use in scene.uses]
    assert ways, f"{kind.__name__} has a reset and no scene"
    for said, mutant in _mutants(kind, method):
        if said in NEEDLESS:
            continue
        first = next((k for k, way in enumerate(ways) if _noticed(*way, kind, method, mutant)), None)
        assert first is not None, said
        ways.insert(0, ways.pop(first))  # what noticed one may notice the next


def test_a_page_says_nothing_of_before() -> None:
    """Its alarm, figures and sentences are those of the last call alone."""
    pytest.importorskip("viser")

    def shown(*told: StreamFigures) -> list[str]:
        page = LivePage(None, (), "page", lambda _: None, port=0)
        try:
            for figures in told:
                page.tell(None, figures)
            words = (page._alarm, page._now, page._figures, page._sentences, page._legend)
            return [*(each.content for each in words), page._tare.label, str(page._tare.disabled)]
        finally:
            page.stop()

    busy = StreamFigures(900.0, (1e-4, 2e-4, 3e-4), 3, 4, 2.0, 5, True, "a tare", ((1, "it hangs"),))
    quiet = StreamFigures(silent=0.1, samples=7)
    assert sum(one != other for one, other in zip(shown(busy), shown(quiet), strict=True)) == 5
    assert shown(busy, quiet) == shown(quiet)
