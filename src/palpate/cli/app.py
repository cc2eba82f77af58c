"""Which commands there are."""

from __future__ import annotations

from collections.abc import Sequence

from tyro.extras import SubcommandApp

from palpate.cli.calibrate_camera import calibrate_camera
from palpate.cli.calibrate_clock import calibrate_clock
from palpate.cli.calibrate_drift import calibrate_drift
from palpate.cli.calibrate_intensity import calibrate_intensity
from palpate.cli.calibrate_load_cells import calibrate_load_cells
from palpate.cli.calibrate_marker_ring import calibrate_marker_ring_command
from palpate.cli.calibrate_mounting import calibrate_mounting
from palpate.cli.calibrate_payload import calibrate_payload
from palpate.cli.calibrate_taxels import calibrate_taxels_command
from palpate.cli.design_load_cells import design_load_cells
from palpate.cli.estimate import estimate
from palpate.cli.evaluate import evaluate
from palpate.cli.events import events
from palpate.cli.inspect import inspect
from palpate.cli.live import live
from palpate.cli.map_skin import map_skin
from palpate.cli.plan_pokes import plan_pokes_command
from palpate.cli.recover import recover
from palpate.cli.replay import replay
from palpate.cli.rig_new import rig_new
from palpate.cli.simulate import simulate_marker_ring
from palpate.cli.simulate_arena import simulate_arena
from palpate.cli.simulate_forearm import simulate_forearm_command
from palpate.cli.simulate_phantom import simulate_phantom
from palpate.cli.view import view

__all__ = ["run"]


def run(argv: Sequence[str]) -> None:
    """Parse and run one command; leaves by `SystemExit` on --help and on a wrong call."""
    app, calibrate, design, maps, plan, rig, simulate = (SubcommandApp() for _ in range(7))
    app.command(estimate)
    calibrate.command(name="camera")(calibrate_camera)
    calibrate.command(name="clock")(calibrate_clock)
    calibrate.command(name="drift")(calibrate_drift)
    calibrate.command(name="intensity")(calibrate_intensity)
    calibrate.command(name="load-cells")(calibrate_load_cells)
    calibrate.command(name="marker-ring")(calibrate_marker_ring_command)
    calibrate.command(name="payload")(calibrate_payload)
    calibrate.command(name="mounting")(calibrate_mounting)
    calibrate.command(name="taxels")(calibrate_taxels_command)
    models = "camera, clock, drift, intensity, load-cells, marker-ring, payload, mounting, taxels"
    app.command(calibrate, name="calibrate", help=f"Make a model from a log: {models}.")
    design.command(name="load-cells")(design_load_cells)
    app.command(design, name="design", help="What a sensor can resolve before it is built: load-cells.")
    app.command(evaluate)
    app.command(events)
    app.command(inspect)
    app.command(live)
    maps.command(name="skin")(map_skin)
    app.command(maps, name="map", help="Find where the cells of a sensor sit on a robot: skin.")
    plan.command(name="pokes")(plan_pokes_command)
    app.command(plan, name="plan", help="What to measure next: pokes.")
    app.command(recover)
    app.command(replay)
    app.command(view)
    rig.command(name="new")(rig_new)
    app.command(rig, name="rig", help="Write a rig to start from: new.")
    simulate.command(name="arena")(simulate_arena)
    simulate.command(name="forearm")(simulate_forearm_command)
    simulate.command(name="marker-ring")(simulate_marker_ring)
    simulate.command(name="phantom")(simulate_phantom)
    simulated = "arena, forearm, marker-ring, phantom"
    app.command(simulate, name="simulate", help=f"Record what is simulated, with its truth: {simulated}.")
    app.cli(prog="palpate", description=_DESCRIPTION, args=list(argv))


_DESCRIPTION = """Where, how hard and in which direction a robot is being touched.

Every command takes --quiet (nothing but warnings and errors, on stderr) and --json (what it says, as JSON)."""
