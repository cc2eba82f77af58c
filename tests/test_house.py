"""Laws of the house itself: the front door, what importing costs, what no tracked file may hold."""

import ast
import importlib
import inspect
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import numpy as np
import pytest
import yaml
from jaxtyping import TypeCheckError

import palpate
from palpate.contact.estimator import ContactEstimator
from palpate.errors import InputError
from palpate.sensors.fused.estimator import FusedEstimator
from palpate.spatial.pose import skew
from tests.size import lines_of_code
from tests.support.checked import CALLS, start_counting
from tests.support.walked import ROOT, tree
from tests.way import measured

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
HEAVY = ("numba", "scipy", "trimesh", "polars", "collada", "tyro", "embreex", "numpy", "jaxtyping")


def _ours() -> list[Path]:
    """The files that a commit of this folder would hold, as git sees them."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listing = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if listing.returncode != 0:
        pytest.skip("not a git checkout: nothing tells our files from made ones")
    files = (ROOT / name for name in listing.stdout.splitlines())
    return [file for file in files if file.is_file()]


def _offending(pattern: str, files: list[Path]) -> list[str]:
    """Each line that holds the pattern, as a reader can find it."""
    return [
        f"{file.relative_to(ROOT)}:{number}: {line.strip()}"
        for file in files
        for number, line in enumerate(file.read_text(encoding="utf-8", errors="replace").splitlines(), start=1)
        if re.search(pattern, line)
    ]


def _targets() -> set[str]:
    return set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE))


def test_the_front_door_is_small() -> None:
    assert 10 <= len(palpate.__all__) <= 42  # what a user types, and no more


@pytest.mark.parametrize("package", sorted(file.parent for file in (ROOT / "src").rglob("__init__.py")))
def test_every_room_exports_what_it_says(package: Path) -> None:
    module = importlib.import_module(".".join(package.relative_to(ROOT / "src").parts))
    assert [name for name in getattr(module, "__all__", []) if not hasattr(module, name)] == []


@pytest.mark.parametrize(
    ("module", "needed"), [("palpate", ()), ("palpate.cli.app", ()), ("palpate.surfaces", ("numpy", "jaxtyping"))]
)
def test_importing_stays_light(module: str, needed: tuple[str, ...]) -> None:
    """Compilers, solvers and mesh readers load when first needed: that, not a clock, is what keeps the import quick."""
    script = f"import sys, {module}; print(*sorted(name.partition('.')[0] for name in sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    assert not (set(HEAVY) - set(needed)) & set(loaded.stdout.split())


def test_shapes_are_checked_in_the_first_calls_of_each_test() -> None:
    wrong = np.zeros(4)
    for _ in range(CALLS):
        with pytest.raises(TypeCheckError):
            skew(wrong)
    with pytest.raises(InputError, match="vector must have shape"):  # what the function itself says of it
        skew(wrong)
    start_counting()
    with pytest.raises(TypeCheckError):
        skew(wrong)


def test_requirements_name_packages_and_no_address() -> None:
    """Where packages come from is the business of the machine that installs them."""
    files = [file for file in _ours() if file.suffix == ".lock" or file.name.startswith("requirements")]
    assert files
    assert _offending(r"://|--(?:extra-)?index-url|--find-links| @ ", files) == []


def test_no_file_knows_the_machine_it_was_written_on() -> None:
    folders = "|".join(["home", "root", "Users", "work", "tmp", "opt"])
    assert _offending(rf"(?<![\w.~$)}}/-])/(?:{folders})/\w", _ours()) == []


def test_the_readme_names_commands_that_exist() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    named = set(re.findall(r"\bmake ([a-z]+)", readme))
    assert {"setup", "demo", "test", "check", "docs"} <= named <= _targets()


def test_ci_runs_what_the_readme_says() -> None:
    """No hidden step: what passes in CI is what a person can type."""
    steps = re.findall(r"make ([a-z]+(?: [a-z]+)*)", (ROOT / ".ci/run").read_text(encoding="utf-8"))
    run = set(" ".join(steps).split())
    assert {"setup", "check", "docs", "demo", "test"} <= run
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert run <= set(re.findall(r"\bmake ([a-z]+)", readme))


def test_the_workflow_runs_what_ci_runs_on_every_python_that_is_supported() -> None:
    (job,) = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8"))["jobs"].values()
    assert job["steps"][-1]["run"] == ".ci/run"
    assert os.access(ROOT / ".ci/run", os.X_OK)
    stated = re.findall(r"Python :: (3\.\d+)", " ".join(PROJECT["classifiers"]))
    assert job["strategy"]["matrix"]["python"] == stated


def test_every_ignored_lint_rule_has_a_reason_beside_it() -> None:
    """In the settings a comment on the same line; in the code words after the rule's name."""
    lines = (ROOT / "pyproject.toml").read_text(encoding="utf-8").splitlines()
    ignored = [line for line in lines if re.match(r'\s+"[A-Z]+\d*",|report\w+ = ', line)]
    assert ignored
    assert [line for line in ignored if not re.search(r"# \w", line)] == []
    code = [file for file in _ours() if file.suffix == ".py" and file != Path(__file__)]
    assert _offending(r"# noqa(?!: [A-Z]+\d+(?:, [A-Z]+\d+)* - \w)", code) == []
    assert _offending(r"# type: ignore", code) == []
    assert _offending(r"# pyright: ignore(?!\[\w+(?:, \w+)*\] - \w)", code) == []


def test_the_changelog_knows_this_version() -> None:
    assert f"## [{PROJECT['version']}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_citation_is_of_this_version_and_licence() -> None:
    stated = dict(re.findall(r"^(\w+): (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE))
    assert (stated["version"], stated["license"]) == (PROJECT["version"], PROJECT["license"])


def test_the_extra_all_has_every_extra_of_a_user() -> None:
    extras = PROJECT["optional-dependencies"]
    assert extras["all"] == [f"palpate[{','.join(sorted(set(extras) - {'all', 'bench'}))}]"]


def test_every_dependency_has_a_lower_bound() -> None:
    every = [*PROJECT["dependencies"], *(one for extra in PROJECT["optional-dependencies"].values() for one in extra)]
    assert [one for one in every if ">=" not in one and not one.startswith("palpate[")] == []


BESIDE = ("mutants", "claims", "examples", "tests")  # each may import what stands before it, and the package


def test_what_stands_beside_the_package_imports_in_one_direction() -> None:
    """No circles: tests use claims and examples, these claims, and claims the package alone."""
    ours = _ours()
    for k, own in enumerate(("src", *BESIDE[:-1])):
        later = rf"(?:from|import) (?:{'|'.join(BESIDE[k:])})\b"
        for file in (each for each in ours if each.suffix == ".py" and each.is_relative_to(ROOT / own)):
            if _offending(rf"^\s*{later}", [file]):  # or a script in a string
                imports = (node for node in ast.walk(tree(file)) if isinstance(node, ast.Import | ast.ImportFrom))
                assert [text for text in map(ast.unparse, imports) if re.match(later, text)] == [], file


def test_no_files_import_each_other_in_a_circle() -> None:
    """Whatever is imported first: a file below a package imports the package's `__init__` too."""
    source = ROOT / "src"
    files = {
        ".".join(file.relative_to(source).with_suffix("").parts).removesuffix(".__init__"): file
        for file in source.rglob("*.py")
    }
    graph = {name: set(_imported(name, file, set(files))) - {name} for name, file in files.items()}
    TopologicalSorter(graph).prepare()  # a CycleError names the files


def _imported(name: str, file: Path, files: set[str]) -> Iterator[str]:
    """Yield the files that a file imports anywhere, and the packages that run when it is imported."""
    top = tree(file).body
    for node in ast.walk(tree(file)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("palpate"):
            module = node.module or ""
            for alias in node.names:
                target = f"{module}.{alias.name}" if f"{module}.{alias.name}" in files else module
                yield target
                while node in top and "." in target:
                    target = target.rpartition(".")[0]
                    if not f"{name}.".startswith(f"{target}."):
                        yield target


@pytest.mark.parametrize(
    "estimator", [palpate.WrenchEstimator, palpate.TaxelEstimator, palpate.RingEstimator, FusedEstimator]
)
def test_estimators_stay_small(estimator: type[ContactEstimator]) -> None:
    lines, _ = inspect.getsourcelines(estimator)
    methods = [name for name, _ in inspect.getmembers(estimator, inspect.isfunction) if not name.startswith("_")]
    assert len(lines) <= 250
    assert len(methods) <= 15


def test_few_functions_take_a_rig() -> None:
    """Below the commands they take a `Setup` or plain values."""
    taken = _offending(r"\brig: Rig\b", [file for file in _ours() if file.is_relative_to(ROOT / "src")])
    assert len(taken) <= 15, taken


def test_the_way_of_a_rig_is_short(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the command to the skin's estimator few files are called, few calls climb, and few frames lie between."""
    monkeypatch.setattr("sys.argv", [])
    skin = ROOT / "tests" / "v03" / "skin"
    files, climbs, frames = measured(["estimate", str(skin / "log.csv"), "--rig", str(skin / "rig.toml")])
    assert "sensors/taxels/estimator.py" in files
    assert (len(files) <= 41, len(climbs) <= 4, frames <= 10) == (True, True, True), (files, climbs, frames)


NAMED = re.compile(
    r"[\"'](force_torque|load_cells|marker_ring|fusion|skin)[\"']"
    r"|isinstance\([^)]*\b(Compensation|LoadCellArray|(Taxel|Ring|Fused)Estimator|(Taxel|Ring|LoadCell)Layer)\b"
)
STILL_NAMED = {  # a shorter list is better
    "setup/kinds.py",
    "files/models/kinds.py",
    "files/logs/topics.py",
}


def test_general_code_names_no_sensor() -> None:
    source = ROOT / "src" / "palpate"
    files = {str(file.relative_to(source)): file for file in source.rglob("*.py")}
    named = {name for name, file in files.items() if NAMED.search(file.read_text()) and not name.startswith("sensors/")}
    assert named == STILL_NAMED


def test_lines_of_code_are_counted_without_docstrings_comments_and_blanks() -> None:
    text = '"""Say."""\n\nX = 1  # one\n# two\n\n\ndef f():\n    """Say\n    more."""\n    return """a\nb"""\n'
    assert lines_of_code(text) == 4


PLAIN = {"said", "told", "doubted", "beside", "whole", "apart", "left", "held", "ahead", "asked"}
NAMED_SO = {  # names with these words, and why
    "left_handed": "handedness, and a key of rigs",
    "left_speed": "the left track of a robot",
    "apart": "a key of [marker_ring.contacts]",
    "left_out": "a key of the ring's model file",
}
RIDDLES = ("What", "Of", "How", "Where", "Whether", "Which", "As", "Those", "One")  # docstrings do not begin so


def _definitions() -> Iterator[tuple[Path, ast.FunctionDef | ast.ClassDef]]:
    """Yield the public functions, methods and classes of files that are not private."""
    for file in sorted((ROOT / "src").rglob("*.py")):
        if file.name.startswith("_") and file.name != "__init__.py":
            continue
        waiting: list[ast.AST] = [tree(file)]
        while waiting:
            for node in ast.iter_child_nodes(waiting.pop()):
                if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                    yield file, node
                    if isinstance(node, ast.ClassDef):
                        waiting.append(node)


def _names(node: ast.FunctionDef | ast.ClassDef) -> Iterator[str]:
    """Yield the name of a definition, and those of its arguments or fields."""
    yield node.name
    if isinstance(node, ast.FunctionDef):
        yield from (each.arg for each in (*node.args.args, *node.args.kwonlyargs))
    else:
        yield from (
            each.target.id
            for each in node.body
            if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)
        )


def test_no_file_lists_again_what_its_names_say() -> None:
    """A name without an underscore is public; `__all__` stands in packages, and in files that offer fewer names."""
    again: list[str] = []
    for file in (ROOT / "src").rglob("*.py"):
        body = [] if file.name == "__init__.py" else tree(file).body
        made = {node.name for node in body if isinstance(node, ast.FunctionDef | ast.ClassDef)}
        for node in (each for each in body if isinstance(each, ast.Assign | ast.AnnAssign)):
            if ast.unparse(node).startswith("__all__") and node.value is not None:
                listed = set[str](ast.literal_eval(node.value))
                if {name for name in made if not name.startswith("_")} <= listed <= made | _assigned(body):
                    again.append(str(file.relative_to(ROOT)))
    assert again == []


def _assigned(body: list[ast.stmt]) -> set[str]:
    """The names that a file assigns to."""
    targets = [each for node in body if isinstance(node, ast.Assign) for each in node.targets]
    targets += [node.target for node in body if isinstance(node, ast.AnnAssign)]
    return {each.id for target in targets for each in ast.walk(target) if isinstance(each, ast.Name)}


def test_public_names_are_plain_words() -> None:
    named = {name for _, node in _definitions() for name in _names(node) if PLAIN & set(name.split("_"))}
    assert named == set(NAMED_SO)


def test_no_two_public_classes_share_a_name() -> None:
    classes = [node.name for _, node in _definitions() if isinstance(node, ast.ClassDef) and node.col_offset == 0]
    assert sorted(name for name in set(classes) if classes.count(name) > 1) == []


def test_docstrings_are_complete_sentences() -> None:
    begun = [
        f"{file.relative_to(ROOT)}:{node.lineno}: {text.splitlines()[0]}"
        for file, node in _definitions()
        if (text := ast.get_docstring(node)) and re.split(r"\W", text, maxsplit=1)[0] in RIDDLES
    ]
    assert begun == []
