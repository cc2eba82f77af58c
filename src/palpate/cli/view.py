"""Run `palpate view`: show the log of any sensor, or a file of contacts, as a page in the browser."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from palpate.cli.contact_files import compared_blocks, on_body, written
from palpate.cli.estimate_robot import require_robot_options
from palpate.cli.rig_options import RigOptions
from palpate.console.console import announce, counting, lines, note, progress, title, wait
from palpate.console.options import FileOption, Log
from palpate.contact.contacts import Contacts
from palpate.errors import InputError
from palpate.files.atomic import reserve_output, sibling_folder
from palpate.files.contacts import read_contacts
from palpate.files.models import read_provenance
from palpate.interrupts import import_mesh_reader
from palpate.opencv import opencv
from palpate.sensors.taxels.files import of_taxels
from palpate.sensors.taxels.place_formats import read_taxel_places
from palpate.sensors.taxels.places_page import serve_taxels
from palpate.sensors.taxels.poking.evaluate_command import is_taxel_file
from palpate.setup import Rig
from palpate.setup.load import robot_of
from palpate.setup.pipeline import OpenedLog, Pipeline
from palpate.setup.robot import Robot
from palpate.setup.robot_view import in_pictures, robot_scene
from palpate.setup.setup import Setup
from palpate.setup.view import LayerData, layers_of, view_of
from palpate.surfaces import Surface
from palpate.viewer.film import RATE, SIZE, ScenePicture
from palpate.viewer.scene import Scene, prepare
from palpate.viewer.server import require_viser, serve
from palpate.viewer.video import Video


def view(
    log: Log,
    /,
    setup: Annotated[RigOptions, arg(name="")],
    compare: Annotated[FileOption, arg(metavar="CONTACTS")] = None,
    film: Annotated[FileOption, arg(metavar="OUT.mp4")] = None,
    port: Annotated[int, arg(metavar="N")] = 8080,
    host: Annotated[str, arg(metavar="ADDRESS")] = "127.0.0.1",
) -> None:
    """Show contacts on the body in a browser.

    Show contacts on the body, with a timeline to scrub and play, in a browser; Ctrl-C ends it.

    Args:
        log: a log of any sensor, which is estimated first, or what `palpate estimate` wrote, which is shown as it is;
            or places of taxels, such as `palpate calibrate taxels` writes.
        setup: what is touched and how it is located.
        compare: other contacts, such as of the same log by other settings, drawn next to these at the same time.
        film: write a video instead of serving a page: at real speed, drawn without a screen or a browser.
        port: port to serve at; the next free one if it is taken.
        host: address to serve at; the default can be reached from this machine only.

    Raises:
        InputError: a file or an option cannot be used, the port or the host cannot be served at, the video exists, or
            viser or OpenCV is not installed.
        OSError: the folder for the video cannot be made.
        GeometryError: the mesh has no usable surface.
    """
    if film is None:
        require_viser(host, port)  # before the work, not after it
    else:
        _require_film(film, log)
    if is_taxel_file(log):
        _view_taxels(log, setup, host, port)
        return
    if setup.rig is not None and (robot := robot_of(setup.rig)) is not None:
        _view_robot(log, robot, setup, compare, film, (host, port))
        return
    rig = setup.load()
    import_mesh_reader()
    contacts = written(log)
    if contacts is None:
        scene, notes = _estimated(log, setup.open(log, rig))
    else:
        scene, notes = _shown(contacts, log, rig, setup.sensor)
    if compare is not None:
        scene = scene.compared(Contacts.joined(list(compared_blocks(compare, rig.resolve().link))), compare.name)
    title(f"{log}: {len(scene):,} samples")
    note(notes)
    if film is not None:
        _write_film(scene, film)
        return
    serve(scene, host, port, up=_announce_address)


def _view_robot(
    log: Path, robot: Robot, setup: RigOptions, compare: Path | None, film: Path | None, address: tuple[str, int]
) -> None:
    """Show a robot that moves, and the contacts on it."""
    require_robot_options(robot, setup)
    if written(log) is not None:
        what = "is a file of contacts, without the joint states that place the robot's links."
        raise InputError(what, where=str(log), hint=f"View the log, and these with it: --compare {log}.")
    other = None if compare is None else _in_base(compare)
    import_mesh_reader()
    wait("finding the contacts of all sensors")
    with counting():
        scene, notes = robot_scene(robot, log, setup.sensor)
    if other is not None and compare is not None:
        scene = scene.compared(in_pictures(other), compare.name)
    title(f"{log}: {len(scene):,} pictures, {len(scene.touches)} touches")
    note(notes)
    if film is not None:
        _write_film(scene, film)
        return
    serve(scene, *address, up=_announce_address)


def _in_base(path: Path) -> Contacts:
    """Read contacts of a robot in the base frame."""
    found = read_contacts(path)
    if found.origins is None or read_provenance(path).get("frame") != "base":
        hint = "Estimate them with the robot's rig and --frame base."
        raise InputError("these are not the contacts of a robot in its base frame.", where=str(path), hint=hint)
    return found


def _announce_address(address: str) -> None:
    announce(f"open {address} in a browser; Ctrl-C ends it")


def _require_film(film: Path, log: Path) -> None:
    """Check, before the work, that the video can be written."""
    opencv()
    if film.suffix != ".mp4":
        raise InputError("is not the name of a video.", where=str(film), hint="Name it OUT.mp4.")
    reserve_output(film)
    if film.exists() or film.is_symlink():
        raise InputError("already exists.", where=str(film), hint="Name another file.")
    if is_taxel_file(log):
        raise InputError("shows contacts over time, and places of taxels do not move.", where="--film")


def _write_film(scene: Scene, path: Path) -> None:
    """Write the video; the file appears when it is complete."""
    pictures = ScenePicture(scene)
    with sibling_folder(path) as part:
        with counting(), closing(Video(part / path.name, SIZE, RATE)) as video:
            times = pictures.times.tolist()
            for done, seconds in enumerate(times):
                video.add(pictures.draw(seconds))
                if done % RATE == 0:
                    progress(done, done / len(times))
        (part / path.name).replace(path)
    announce(f"{len(times):,} pictures, {times[-1]:.1f} s -> {path}")


def _view_taxels(path: Path, setup: RigOptions, host: str, port: int) -> None:
    """Show taxels, on the link of the rig if there is one."""
    rig = None if setup.rig is None and setup.mesh is None else setup.load()
    import_mesh_reader()
    places = read_taxel_places(path)
    facts = of_taxels(places)
    title(f"{path}: places of taxels")
    lines(facts)
    note(places.notes)
    surface = None if rig is None else _body(rig.resolve())
    shown = places if surface is None else places.in_surface()
    serve_taxels(shown, surface, path.name, facts, host=host, port=port, up=_announce_address)


def _estimated(path: Path, log: OpenedLog) -> tuple[Scene, list[str]]:
    """Estimate a log and return its scene, and notes about it."""
    wait("preparing the surface")
    pipeline = Pipeline.of(log)
    kept, parts, done = LayerData(), list[Contacts](), 0
    with counting():
        for block, found, _ in pipeline.stream(kept.keep):
            parts.append(found)
            done += len(block)
            progress(done, log.position / max(log.size, 1))
    layers = layers_of(log.setup, kept)
    scene = prepare(_body(log.setup), Contacts.joined(parts), path.name, layers)
    return scene, [*([log.torn] if log.torn else []), *pipeline.warnings(), *pipeline.notes()]


def _body(setup: Setup) -> Surface | None:
    return view_of(setup.kind).body(setup)


def _shown(contacts: Contacts, path: Path, rig: Rig, sensor: str | None) -> tuple[Scene, list[str]]:
    """Return the scene of contacts from a file, and their notes."""
    main = next((kind for kind in rig.kinds if kind.parts), rig.kinds[0])  # of a file that does not name its sensor
    name = sensor or str(read_provenance(path).get("sensor", main.name))
    kind = next((each for each in rig.kinds if each.name == name), None)
    setup = rig.resolve(kind)
    contacts = on_body(contacts, path, setup.link)
    layers = () if kind is None else layers_of(setup)
    return prepare(_body(setup), contacts, path.name, layers), list(contacts.notes)
