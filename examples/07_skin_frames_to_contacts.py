"""Frames of a taxel sheet become contacts, several at once, each with an identity, a force and an area."""

import numpy as np

import palpate
from palpate.sensors.taxels import identify_intensity
from palpate_lab.simulation import load_cell_presses, simulate_protocol

# A sheet of 6 x 22 cells round a wrist, pressed eight times; and what a load cell said of each of its cells.
rng = np.random.default_rng(7)
session = simulate_protocol(rng, touches=8, width=2.0)
force, counts, cell = load_cell_presses(session.sheet, session.model, rng, presses=20)

intensity = identify_intensity(force, counts, cell, top=255.0)
place = session.sheet.layout()  # where the cells are; of your own link palpate.map_skin(mesh, sheet, ...) says it
skin = palpate.TaxelEstimator(palpate.TaxelBody.sheet(place), intensity)

skin.tare(session.frames.picked(session.frames.time < 0.8))
contacts = skin.run(session.frames)

for k in range(1, contacts.identity.max() + 1):
    own = contacts[contacts.identity == k]
    strongest = own.features["load"].argmax()
    area = 1e4 * own.features["area"][strongest]
    print(f"touch {k}: from {own.time[0]:.2f} s, {own.features['load'][strongest]:.1f} N on {area:.1f} cm2")

middle = 0.5 * (session.start + session.end)
row = [np.abs(contacts.time - when).argmin() for when in middle]
off = np.linalg.norm(contacts.point[row] - session.point, axis=1)
print(f"{len(row)} touches, off by {1e3 * np.median(off):.2f} mm (median); a cell is 10 mm wide")
