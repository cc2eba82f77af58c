"""The laws of a stream, for every sensor: a replayed log is answered as the log is, and the live page draws that."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import palpate
from palpate.cli.live_page_stream import Stream
from palpate.contact.estimate import ROW
from palpate.files.logs import join
from palpate.files.logs.decoding import seconds
from palpate.live.live import AnsweredSamples, Live
from palpate.live.replay import Replay, bare
from palpate.live.stream_buffer import StreamBuffer
from palpate.sensors.marker_ring.layer import RingLayer
from palpate.sensors.taxels.layer import TaxelLayer
from palpate.setup.pipeline import OpenedLog
from palpate.setup.source import RigSource
from palpate.setup.tables import RigOrientation
from palpate.setup.view import layers_of, view_of
from palpate.signals.recent_motion import RecentMotion
from palpate.signals.recording import ORIENTATION, POSITION, UNSTEADY
from palpate.viewer.live import LivePage
from tests.conformance.fields import Case, same
from tests.conformance.live import replayed
from tests.conformance.sensors import SENSORS, Sensor

pytest.importorskip("viser")

SENSOR = pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: sensor.name)


@SENSOR
def test_a_source_without_poses_is_answered_or_refused_before_it_is_opened(
    case_of: Callable[[Sensor], Case], sensor: Sensor
) -> None:
    case = case_of(sensor)
    rig = palpate.load_rig(str(case.files.rig))
    source = Replay(case.files.log, bare(rig.layout()), speed=0.0)
    source.poses = False
    nowhere = RigOrientation(topic="none")  # or it would listen to ROS 2
    rig = replace(rig, source=RigSource("replay", str(case.files.log), speed=0.0), orientation=nowhere)
    if sensor.table == "force_torque":
        with pytest.raises(palpate.InputError, match="payload's weight turns"):
            Live(rig, source=source)
        return
    with Live(rig, source=source) as live:
        rows = [row for _, row in live]
    status = np.array([row[ROW.status] for row in rows])
    assert len(rows) >= 100
    assert np.isin(status, [palpate.Status.CONTACT, palpate.Status.AMBIGUOUS]).any()


@SENSOR
def test_a_replayed_log_is_answered_as_the_log_is(
    case_of: Callable[[Sensor], Case], sensor: Sensor, tmp_path: Path
) -> None:
    """The bits of `run` by an estimator that was prepared from the same start; times are rounded to ns."""
    live = replayed(case_of(sensor).files.log, case_of(sensor).files.rig)
    ring = StreamBuffer.make(tmp_path / "ring", live.form(), 1 << 27)
    live.into(ring)
    found: list[AnsweredSamples] = []
    with live:
        while not live.source.ended:
            found.append(live.step(0.0))
        found.append(live.finish())
    assert not [said for said in live.events() if "invalid until" in said]
    with OpenedLog(live.source.path, live.setup) as opened:
        recording = join(list(opened))
    channels = {name: values for name, values in recording.channels.items() if name != UNSTEADY}
    stamps = np.rint(np.nan_to_num(recording.time) * 1e9).astype(np.int64)
    assert np.array_equal(np.concatenate([each.stamp for each in found]), stamps)
    rows = np.concatenate([each.rows for each in found])
    live.estimator.reset()
    if live._motion is not None:
        made, still = (
            RecentMotion(live.estimator.sensor.payload.center_of_mass, answers=False),
            np.zeros((len(stamps), 1)),
        )
        _, channels[UNSTEADY] = made.at(seconds(stamps), channels[ORIENTATION], channels[POSITION], still)
    known = live.estimator.run(replace(recording, channels=channels))
    assert np.array_equal(np.bincount(known.sample), np.concatenate([each.counts for each in found]))
    assert np.array_equal(rows[:, ROW.point], known.point, equal_nan=True)
    assert np.array_equal(rows[:, ROW.force], known.force, equal_nan=True)
    assert np.array_equal(rows[:, ROW.covariance].reshape(-1, 3, 3), known.covariance, equal_nan=True)
    assert np.array_equal(rows[:, ROW.status], known.status)
    assert known.answered.any()
    slots, first = ring.read(0, len(recording))
    through = ring.form.contacts(slots)
    same(
        through.to_polars().drop("time"),
        known.to_polars().drop("time").slice(int(np.searchsorted(known.sample, first))),
    )
    ring.close()


PICTURES = 24  # over a log


@pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: sensor.name)
def test_the_page_draws_what_passes_through_the_ring(
    case_of: Callable[[Sensor], Case], sensor: Sensor, tmp_path: Path
) -> None:
    """The contact of the last sample, after each part.

    Cells of the page's own estimator, whose rest is another, carry what the contacts do, to noise of all cells.
    """
    case = case_of(sensor)
    live = replayed(case.files.log, case.files.rig)
    whole = StreamBuffer.make(tmp_path / "whole", live.form(), 1 << 27)
    live.into(whole)
    with live:
        while not live.source.ended:
            live.step(0.0)
        live.finish()
    ring = StreamBuffer.make(tmp_path / "ring", live.form(), 1 << 27)
    setup = palpate.load_rig(str(case.files.rig)).resolve(ring.form.sensor)
    view, layers = view_of(setup.kind), layers_of(setup, live=ring.form.shape)
    stream = Stream(ring, view.feed(setup, lambda: ring["done"], layers))
    carried, touched = list[tuple[float, float]](), 0
    with LivePage(view.body(setup), layers, sensor.name, stream.tare, port=0) as page:
        end = min(whole["answered"], len(whole.slots))
        for begin, until in pairwise(np.linspace(0, end, PICTURES + 1).astype(int).tolist()):
            ring.slots[begin:until] = whole.slots[begin:until]
            ring["received"] = ring["answered"] = until
            stream.look(watched=True)
            newest = stream.newest
            stream.gather()
            assert newest is not None
            page.show(newest)
            page.tell(stream.window, stream.figures())
            moment = page.scene.at(len(page.scene) - 1)
            assert moment.sample == newest.sample[0] == until - 1
            strongest = newest.strongest()[0]
            assert np.array_equal(moment.contacts[0].point, newest.point[strongest], equal_nan=True)
            assert page._scene3d._markers[0]._arrow.visible == bool(newest.located[strongest])
            touched += int(newest.answered.all())
            for layer in layers:
                if isinstance(layer, TaxelLayer) and newest.answered.all() and layer._fed.any():
                    carried.append((float(layer._fed.sum()), float(newest.features["load"].sum())))
                if isinstance(layer, RingLayer):
                    assert np.isfinite(layer._fed[1]).mean() > 0.5
    assert touched
    if carried:
        cells, contacts = np.array(carried).T
        np.testing.assert_allclose(cells, contacts, rtol=0.15)
    assert bool(carried) == any(isinstance(layer, TaxelLayer) for layer in layers)
    ring.close()
    whole.close()
