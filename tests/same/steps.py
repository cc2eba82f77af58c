"""List what is played: every command of every sensor of the conformance table, live paths, bad inputs, simulations."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from claims.evidence.mutated import KINDS, bench, spoil
from tests.conformance.fields import run
from tests.conformance.sensors import SENSORS, Files, Sensor

BAD = 300  # inputs
JSON = ("inspect", "evaluate", "events", "estimate")  # whose words are taken as JSON, too
WORLDS = {
    "forearm": "simulate forearm",
    "load_cells": "simulate load-cells",
    "marker_ring": "simulate marker-ring --small",
    "pokes": "simulate pokes",
    "phantom.mcap": "simulate phantom --seconds 2",
    "arena.mcap": "simulate arena --seconds 5",
}
SOURCE = '\n[source]\nkind = "replay"\naddress = "{log}"\nspeed = 0.0\n'


def made(folder: Path) -> list[dict[str, Any]]:
    """Write the inputs into a folder, and return the steps."""
    steps: list[dict[str, Any]] = [{"folder": ".", "python": "helps", "given": []}]
    for sensor in SENSORS:
        where = folder / sensor.name.replace(" ", "_")
        where.mkdir()
        if sensor.added is not None:
            steps.append({"folder": ".", "python": "added", "given": [sensor.added]})
        steps += _of_sensor(sensor, sensor.files(where, run))
    steps += _bad(folder / "bad")
    (folder / "worlds").mkdir()
    for name, words in WORLDS.items():
        steps.append({"folder": "worlds", "words": [*words.split(), "-o", name]})
    for number, step in enumerate(steps):
        step["name"] = f"{number:04d}"
    return steps


def _of_sensor(sensor: Sensor, files: Files) -> Iterator[dict[str, Any]]:
    """What a user does with the sensor's files; each result has a name of its own."""
    folder = files.folder
    log, rig, truth = files.log.name, files.rig.name, "known.csv"
    files.truth.write(folder / truth)
    (folder / "live.toml").write_text(files.rig.read_text() + SOURCE.format(log=log))

    def command(*words: object) -> dict[str, Any]:
        return {"folder": folder.name, "words": [str(word).replace(f"{folder}/", "") for word in words]}

    def python(name: str, *given: str) -> dict[str, Any]:
        return {"folder": folder.name, "python": name, "given": list(given)}

    estimate = ("estimate", log, "--rig", rig)
    several = [
        ("inspect", log),
        ("inspect", log, "--rig", rig),
        ("inspect", rig),
        *(("inspect", model) for model in files.models),
        ("rig", "new", log, *([files.mesh.name] if files.mesh else []), "-o", "new.toml", "--force"),
        *(("calibrate", *words) for words in files.calibrations),
        *((*estimate, "-o", f"contacts{suffix}") for suffix in (".csv", ".parquet", ".mcap")),
        *((*estimate, "-o", f"{frame}.csv", "--frame", frame) for frame in ("sensor", "base")),
        *(
            (*estimate, "-o", f"{kind}.csv", "--filter", kind, "--cutoff", "15")
            for kind in ("butterworth", "zero_phase")
        ),
        (*estimate, "-o", "reported.csv", "--report", "report.html", "--truth", truth),
        (*estimate, "--workers", "2", "-o", "workers.csv"),
        *((*estimate, "-o", "refused.csv", option, "1") for option in sensor.ignores),
        estimate,
        ("evaluate", "contacts.csv", truth),
        ("events", "contacts.csv", "-o", "touches.csv"),
        ("inspect", "contacts.csv"),
        ("batch", log, "--rig", rig, "-o", "batch"),
    ]
    for words in several:
        yield command(*words)
        if words[0] in JSON and "-o" not in words:
            yield command(*words, "--json")
    yield python("front_door", log, rig)
    if sensor.added is None:  # others would have to be added to each of its processes
        yield command("live", "--rig", "live.toml", "--record", "live.mcap", "--realtime", "False")
        yield python("as_table", "live.mcap")


def _bad(folder: Path) -> Iterator[dict[str, Any]]:
    """Spoil as many files of each kind, and return the commands that are given them."""
    cases = [(name, number) for number in range(-(-BAD // len(KINDS))) for name in KINDS][:BAD]
    with bench() as good:
        shutil.copytree(good, folder)
        for count, (name, number) in enumerate(cases):
            command, bad, out = spoil(name, number)
            own = f"{count}_{bad.name}"
            (shutil.copytree if bad.is_dir() else shutil.copy)(bad, folder / own)
            names = {str(bad): own, str(out): f"{count}_{out.name}", "made.toml": f"{count}_made.toml"}
            yield {"folder": folder.name, "words": [names.get(word, word) for word in command.split()]}
