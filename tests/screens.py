"""Pictures of every page in a browser, at a desk and on a phone, to be looked at.

Run: `make screens`, or `python -m tests.screens FOLDER [NAME ...]`; minutes. Six sensors of the conformance table, the
arena and the phantom, each by the command that a person types. Their files are made once, in FOLDER/files; the
pictures are FOLDER/NAME_WIDTH.png.
"""

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from palpate.cli import main as palpate_command
from tests.conformance.sensors import SENSORS, Sensor
from tests.support.browser import PATIENCE, chromium, opened

SIZES = ((1440, 900), (390, 844))
ADDRESS = re.compile(r"http://\S+")
LIVE = {
    "arena": ("simulate", "arena", "--seed", "7", "--view", "--port", "0"),
    "phantom": ("simulate", "phantom", "--seconds", "3600", "--view", "--port", "0"),
}
DRAWN = 4.0  # s between two looks at a page
LOOKS = 8  # at most, until two are the same: one that moves may never be


def main() -> None:
    """Each page that is named, or all."""
    folder, names = Path(sys.argv[1]).resolve(), sys.argv[2:]
    sensors = {sensor.name.replace(" ", "_"): sensor for sensor in SENSORS if sensor.added is None}
    with chromium() as browser:
        for name in names or (*sensors, *LIVE):
            with _served(_words(name, sensors.get(name), folder / "files" / name)) as address:
                for width, height in SIZES:
                    picture = folder / f"{name}_{width}.png"
                    _photograph(browser, address, (width, height), picture)
                    sys.stdout.write(f"{picture}\n")


def _words(name: str, sensor: Sensor | None, folder: Path) -> tuple[str, ...]:
    """The command behind `palpate`."""
    folder.mkdir(parents=True, exist_ok=True)
    if sensor is None:
        return (*LIVE[name], "-o", str(folder / "run.mcap"))
    made = folder / "rig"
    if not made.exists():
        log, rig = (getattr(sensor.files(folder, _run), each) for each in ("log", "rig"))
        made.write_text(f"{log}\n{rig}\n")
    log, rig = made.read_text().split("\n")[:2]
    return ("view", log, "--rig", rig, "--port", "0")


def _run(*words: str) -> str:
    if code := palpate_command(list(words)):
        raise SystemExit(f"palpate {' '.join(words)} left with {code}")
    return ""


@contextmanager
def _served(words: tuple[str, ...]) -> Iterator[str]:
    """The address that a command announces; it is interrupted afterwards."""
    process = subprocess.Popen(
        [sys.executable, "-m", "palpate", *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert process.stdout is not None
    try:
        for line in process.stdout:
            if found := ADDRESS.search(line):
                yield found.group()
                return
        raise SystemExit(f"no page: palpate {' '.join(words)}")
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(PATIENCE)


def _photograph(browser: Any, address: str, size: tuple[int, int], picture: Path) -> None:
    """A page as it opens, once it is drawn; one that moves stands still."""
    view: Any = opened(browser, address, *size, has_touch=size[0] < 600)
    view.wait_for_selector("canvas")
    view.locator(".mantine-Notification-closeButton").first.click()  # that there is no graphics card here
    view.wait_for_timeout(1e3 * DRAWN)
    for button in view.get_by_role("button", name="Pause").all():
        button.click()  # all of the picture is of one moment
    shown, before = view.screenshot(), b""
    for _ in range(LOOKS):  # a browser without a graphics card takes long to draw all, the words last
        if shown == before:
            break
        view.wait_for_timeout(1e3 * DRAWN)
        shown, before = view.screenshot(), shown
    picture.write_bytes(shown)
    view.close()


if __name__ == "__main__":
    main()
