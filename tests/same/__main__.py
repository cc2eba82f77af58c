"""Does this checkout answer as another commit does? `python -m tests.same COMMIT` plays both over the same inputs."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from time import perf_counter

from tests.same.compare import differences
from tests.same.steps import made

ROOT = Path(__file__).parents[2]
CACHE = ROOT / ".cache" / "same"
SIDES = ("before", "after")


def main(commit: str) -> int:
    """Print what differs, and return 1 where something does."""
    begin = perf_counter()
    tree = _checked_out(commit)
    for side in ("inputs", *SIDES):
        shutil.rmtree(CACHE / side, ignore_errors=True)
    (CACHE / "inputs").mkdir(parents=True)
    sys.path.append(str(ROOT / "tests" / "conformance" / "outside"))  # a package with sensors that are not Palpate's
    steps = made(CACHE / "inputs")
    (CACHE / "steps.json").write_text(json.dumps(steps))
    print(f"{len(steps)} steps; inputs made in {perf_counter() - begin:.0f} s", flush=True)
    playing = [_playing(*both) for both in zip(SIDES, (tree, ROOT), strict=True)]
    if any([each.wait() for each in playing]):
        raise SystemExit(f"playing the steps failed: see {CACHE}/before.log and after.log")
    found = list(differences(*(CACHE / side for side in SIDES)))
    print(*found, sep="\n")
    count = sum(path.is_file() for path in (CACHE / "after").rglob("*"))
    print(f"{len(steps)} steps, {count} files: {len(found)} differ from {commit}; {perf_counter() - begin:.0f} s")
    return 1 if found else 0


def _checked_out(commit: str) -> Path:
    """The commit's tree, with its kernels compiled."""
    name = subprocess.check_output(["git", "rev-parse", "--short=12", f"{commit}^{{commit}}"], text=True, cwd=ROOT)
    tree = CACHE / name.strip()
    if not tree.exists():
        (part := tree.with_suffix(".part")).mkdir(parents=True, exist_ok=True)
        packed = subprocess.run(["git", "archive", commit], check=True, capture_output=True, cwd=ROOT)
        subprocess.run(["tar", "-x", "-C", str(part)], input=packed.stdout, check=True)
        part.rename(tree)
    native = Path("src/palpate/_native")
    shutil.copytree(ROOT / native, tree / native, dirs_exist_ok=True)  # those of the same kernels bear the same name
    subprocess.run([sys.executable, "native_build.py"], check=True, cwd=tree, env=_surroundings(tree))
    return tree


def _surroundings(tree: Path) -> dict[str, str]:
    """The same order of sets on both sides, and one thread of polars."""
    mine = {"PYTHONPATH": f"{tree / 'src'}{os.pathsep}{tree}", "PYTHONHASHSEED": "0", "POLARS_MAX_THREADS": "1"}
    return os.environ | mine


def _playing(side: str, tree: Path) -> subprocess.Popen[bytes]:
    """The steps, played by a tree in a copy of the inputs."""
    shutil.copytree(CACHE / "inputs", CACHE / side)
    script = [sys.executable, str(Path(__file__).with_name("play.py")), str(CACHE / "steps.json"), str(CACHE / side)]
    with (CACHE / f"{side}.log").open("w") as heard:  # what compiled code prints past Python
        return subprocess.Popen(script, cwd=tree, env=_surroundings(tree), stderr=heard)


if __name__ == "__main__":
    if len(sys.argv) != 2 or not sys.argv[1]:
        raise SystemExit("name the commit to compare with: make same BASE=HEAD~1")
    raise SystemExit(main(sys.argv[1]))
