"""The live page of every sensor: what passes through the ring is what it draws, with what the sensor adds to it."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import palpate
from palpate.cli.live_page_stream import Stream
from palpate.live.stream_buffer import StreamBuffer
from palpate.sensors.marker_ring.layer import RingLayer
from palpate.sensors.taxels.layer import TaxelLayer
from palpate.setup.view import layers_of, view_of
from palpate.viewer.live import LivePage
from tests.conformance.fields import Case
from tests.conformance.live import replayed
from tests.conformance.sensors import SENSORS, Sensor

pytest.importorskip("viser")

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
