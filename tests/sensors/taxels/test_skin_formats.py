"""A log of a skin in the format of a maker or a recorder is read taxel by taxel, or refused with the reason."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from palpate.errors import InputError
from palpate.files.logs import read_recording
from palpate.files.logs.samples import SampleReader
from palpate.live.replay import bare
from palpate.sensors.taxels.section import SkinSection
from palpate.setup import load_rig
from palpate.setup.new import Proposal, propose_rig
from palpate.signals.recording import CELLS
from tests.support.skin_formats import COLUMNS, FRAMES, PITCH, REFUSED, RIGHT, ROWS, THREE, TIME, XYZ, table


def _frames(log: Path, proposal: Proposal, *more: str) -> tuple[np.ndarray, np.ndarray]:
    """Return times from the first on, and frames, as the proposed rig reads them, with its sheet's true size."""
    edited = {"rows": ROWS, "columns": COLUMNS, "pitch": PITCH}
    lines = [line for line in proposal.text.splitlines() if line.partition(" =")[0] not in edited]
    stated = "\n".join(f"{key} = {value}" for key, value in edited.items())
    rig = log.parent / "rig.toml"
    rig.write_text("\n".join(lines).replace("[skin]", "\n".join(["[skin]", stated, *more])) + "\n")
    recording = read_recording(log, load_rig(rig).layout())
    return recording.time - recording.time[0], recording.channels[CELLS]


@pytest.mark.parametrize("name", RIGHT)
def test_a_format_is_read_taxel_by_taxel(name: str, tmp_path: Path) -> None:
    file, write, newtons, rate = RIGHT[name]
    write(tmp_path / file)
    proposal = propose_rig(tmp_path / file, None, tmp_path, rate=rate)
    time, frames = _frames(tmp_path / file, proposal)
    known = np.isfinite(frames)
    assert np.count_nonzero(~known) == (name == "long_lost")
    np.testing.assert_allclose(frames[known], newtons * FRAMES[known], rtol=1e-9)
    np.testing.assert_allclose(time, TIME, atol=1e-6)
    sized = "nothing states the sheet's rows and columns" not in proposal.text + " ".join(proposal.remarks)
    assert sized == (f"rows = {ROWS}\ncolumns = {COLUMNS}\n" in proposal.text)


@pytest.mark.parametrize("name", REFUSED)
def test_a_format_that_holds_too_little_is_refused(name: str, tmp_path: Path) -> None:
    file, write, reason = REFUSED[name]
    write(tmp_path / file)
    with pytest.raises(InputError, match=reason):
        propose_rig(tmp_path / file, None, tmp_path)


@pytest.mark.parametrize(("name", "path"), [("axes", "*_z"), ("axes_blocks", "z*")])
def test_a_field_path_picks_one_axis(name: str, path: str, tmp_path: Path) -> None:
    file, write = THREE[name]
    write(tmp_path / file)
    stated = Proposal(f'[skin]\ncells = "{path}"\n', "", "", ())
    np.testing.assert_array_equal(_frames(tmp_path / file, stated)[1], XYZ[..., 2])


@pytest.mark.parametrize("name", THREE)
def test_three_axes_are_read_taxel_by_taxel(name: str, tmp_path: Path) -> None:
    """By a sheet as proposed, and by taxels anywhere in a list; a skin of one axis names the key that is missing."""
    file, write = THREE[name]
    write(tmp_path / file)
    proposal = propose_rig(tmp_path / file, None, tmp_path)
    assert "three axes" in proposal.why + " ".join(proposal.remarks)
    more = [] if "axes = " in proposal.text else ['axes = ["x", "y", "z"]']  # 3 x 24 may be a sheet of three rows
    time, frames = _frames(tmp_path / file, proposal, *more)
    np.testing.assert_array_equal(frames, XYZ)
    np.testing.assert_allclose(time, TIME, atol=1e-6)
    (tmp_path / "places.csv").write_text("\n".join(["x,y,z", *(f"{0.01 * k},0,0" for k in range(24)), ""]))
    sheet = [line for line in proposal.text.splitlines() if not line.startswith(("pitch", "rows", "columns"))]
    rig = tmp_path / "rig.toml"
    listed = "\n".join(['[skin]\ntaxels = "places.csv"', *more])
    rig.write_text("\n".join(sheet).replace("[skin]", listed))
    recording = read_recording(tmp_path / file, load_rig(rig).layout())
    body = load_rig(rig).resolve().of(SkinSection).body
    normal, sideways = body.loads(recording)  # a count is taken for a newton
    np.testing.assert_array_equal(np.stack([*np.split(sideways, 2, axis=1), normal], axis=2).reshape(XYZ.shape), XYZ)
    with pytest.raises(InputError, match=r"frames of 24 x 3 cells.* need axes"):
        replace(body, response=None).readings(recording)
    if name not in ("axes_members", "axes_xela"):  # their field paths are of three axes
        one = "\n".join(line for line in sheet if not line.startswith("axes"))
        rig.write_text(one.replace("[skin]", '[skin]\ntaxels = "places.csv"'))
        with pytest.raises(InputError, match=r"three axes a taxel.*axes = \["):
            read_recording(tmp_path / file, load_rig(rig).layout())


def test_axes_that_a_log_has_not_are_named(tmp_path: Path) -> None:
    names = [f"{k}_{axis}" for k in range(24) for axis in "xyz"]
    values, skin = XYZ.reshape(len(XYZ), -1), f'{SHEET}axes = ["x", "y", "z"]'
    for picked, reason in (
        ([k for k in range(72) if k != 22], r"no axis 'y' \(\*_y\) of taxel 7.*Each"),
        (range(69), "names 69 columns|has 69 columns"),
        (range(2, 72, 3), r"one column a taxel.*Remove axes"),
    ):
        with pytest.raises(InputError, match=reason):
            _read(tmp_path, skin, [names[k] for k in picked], values[:, list(picked)])
    np.savez(tmp_path / "log.npz", time=TIME, frames=FRAMES)
    with pytest.raises(InputError, match=r"array 'frames' holds n x 6 x 4 numbers, one a taxel.*names axes x, y, z"):
        read_recording(tmp_path / "log.npz", load_rig(tmp_path / "rig.toml").layout())
    hands = [f"{side}_{name}" for side in "lr" for name in names]
    with pytest.raises(InputError, match=r'2 could be the cells: l_\*_\*, r_\*_\*.*cells = "l_\*_\*"'):
        _read(tmp_path, skin, hands, np.concatenate([values, values], axis=1))
    right = _read(tmp_path, f'{skin}\ncells = "r_*_*"', hands, np.concatenate([0 * values, values], axis=1))
    np.testing.assert_array_equal(right, XYZ)
    for axes in ('["z", "y", "x"]', '["x", "y"]', '["x", "y", "w"]'):
        with pytest.raises(InputError, match=r"skin: .*end in x, y and z, in this order"):
            _read(tmp_path, f"{SHEET}axes = {axes}", names, values)


def test_axes_of_a_sheet_that_runs_down_its_columns(tmp_path: Path) -> None:
    skin = f'{SHEET}order = "columns"\naxes = ["x", "y", "z"]'
    down = XYZ.swapaxes(1, 2).reshape(len(XYZ), -1)
    names = [f"{k}_{axis}" for k in range(24) for axis in "xyz"]
    np.testing.assert_array_equal(_read(tmp_path, skin, names, down), XYZ)
    layout = load_rig(tmp_path / "rig.toml").layout()
    np.testing.assert_array_equal(SampleReader(layout, tmp_path).readings(down), XYZ)  # as a live source gives them


def _read(folder: Path, skin: str, names: list[str], values: np.ndarray) -> np.ndarray:
    """Return the frames of a table of these columns, as a rig with these lines of [skin] reads them."""
    table(names, values)(folder / "log.csv")
    (folder / "rig.toml").write_text(f"[skin]\n{skin}\n")
    return read_recording(folder / "log.csv", load_rig(folder / "rig.toml").layout()).channels[CELLS]


ORDERS: list[tuple[Sequence[int], Sequence[int], str]] = [  # ids of places and of columns, and the former's name
    (range(24), range(24), "id"),
    (range(24), range(1, 25), "taxel"),
    (range(5, 29), range(5, 29), "index"),
    ([*range(3, 15), *range(20, 32)], [*range(3, 15), *range(20, 32)], "number"),
    (range(1, 25), range(26), "id"),
    (range(1, 25), range(1, 25), "name"),
]


def test_places_and_columns_in_any_order_are_the_same_taxels(tmp_path: Path) -> None:
    """Ids join them: shuffled rows of places, shuffled columns, ids from 1 and from 0, gaps, names."""
    rng = np.random.default_rng(3)
    for ids, columns, named in ORDERS:
        rows = [f"{'S' * (named == 'name')}{i},{0.01 * k},0,0" for k, i in enumerate(ids)]
        shuffled = "\n".join(rows[k] for k in map(int, rng.permutation(len(rows))))
        (tmp_path / "places.csv").write_text(f"{named},x,y,z\n{shuffled}\n")
        order = np.array(columns)
        start = order.min() if len(order) == len(rows) else 1  # more columns than places: the same ids
        values = np.arange(len(FRAMES))[:, None] + (order - start)
        picked = rng.permutation(len(order))
        found = _read(tmp_path, 'taxels = "places.csv"', [f"S{order[k]}" for k in picked], values[:, picked])
        np.testing.assert_array_equal(found[0], np.array(ids) - min(ids))


@pytest.mark.parametrize(
    ("ids", "columns"), [([*range(1, 13), *range(14, 26)], range(24)), (range(24), [*range(12), *range(13, 25)])]
)
def test_ids_that_do_not_fit_are_refused(ids: list[int], columns: list[int], tmp_path: Path) -> None:
    rows = [f"{i},{0.01 * k},0,0" for k, i in enumerate(ids)]
    (tmp_path / "places.csv").write_text("\n".join(["id,x,y,z", *rows, ""]))
    with pytest.raises(InputError, match=r"the taxels' ids are.*Give"):
        _read(tmp_path, 'taxels = "places.csv"', [f"S{k}" for k in columns], FRAMES.reshape(len(FRAMES), -1))


SHEET = f"pitch = 0.005\nrows = {ROWS}\ncolumns = {COLUMNS}\n"
DOWN = FRAMES.swapaxes(1, 2).reshape(len(FRAMES), -1)  # column by column


def test_numbers_that_run_down_the_columns_are_read_so(tmp_path: Path) -> None:
    skin = f'{SHEET}order = "columns"\n'
    first = [f"c_{column}_{row}" for column in range(COLUMNS) for row in range(ROWS)]
    letters = [f"r{row}c{column}" for column in range(COLUMNS) for row in range(ROWS)]
    for names in ([f"p{k}" for k in range(24)], first, letters):
        np.testing.assert_array_equal(_read(tmp_path, skin, names, DOWN), FRAMES)
    layout = load_rig(tmp_path / "rig.toml").layout()
    for frames in (DOWN, FRAMES.swapaxes(1, 2)):
        np.savez(tmp_path / "log.npz", time=TIME, pad=frames)
        np.testing.assert_array_equal(read_recording(tmp_path / "log.npz", layout).channels[CELLS], FRAMES)
    np.testing.assert_array_equal(SampleReader(layout, tmp_path).readings(DOWN), FRAMES)
    raw = read_recording(tmp_path / "log.npz", bare(layout)).channels[CELLS]
    np.testing.assert_array_equal(SampleReader(layout, tmp_path).readings(raw), FRAMES)


@pytest.mark.parametrize(
    ("skin", "names", "reason"),
    [
        ("", [f"t_{k // 6}_{k % 6}" for k in range(24)], 'state 4 x 6 cells, not 6 x 4.*order = "columns"'),
        ("", [f"{side}{k}" for side in "lr" for k in range(24)], 'cells = "l\\*"'),
        ("", [f"S{k} [kPa]" for k in range(24)], 'unit = "kPa"'),
        ('unit = "N"', [f"S{k} [kPa]" for k in range(24)], 'unit = "kPa"'),
        ('cells = "taxel_*"', [f"S{k}" for k in range(24)], "names 0 columns.*Correct"),
        ("", [f"S{k}" for k in range(23)], "has 23 columns.*Correct"),
    ],
)
def test_what_names_contradict_is_refused(skin: str, names: list[str], reason: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=reason):
        _read(tmp_path, SHEET + skin, names, np.resize(FRAMES, (len(FRAMES), len(names))))


def test_a_frame_of_another_size_is_not_known(tmp_path: Path) -> None:
    """Of a text with frames of several lines; one that was cut at the end is none."""
    texts = ["\n".join(" ".join(f"{x:g}" for x in row) for row in frame) for frame in FRAMES.tolist()]
    texts[3], texts[-1] = texts[3].partition("\n")[2], texts[-1][:40]
    texts[5] = "B" + texts[5][texts[5].index(" ") :]
    (tmp_path / "log.txt").write_text("\n\n".join(texts))
    (tmp_path / "rig.toml").write_text(f"[skin]\n{SHEET}rate = 100\n")
    found = read_recording(tmp_path / "log.txt", load_rig(tmp_path / "rig.toml").layout()).channels[CELLS]
    wanted = FRAMES[:-1].copy()
    wanted[3], wanted[5, 0, 0] = np.nan, 0.0
    np.testing.assert_array_equal(found, wanted)


def test_episodes_in_one_file_are_refused_unless_one_is_named(tmp_path: Path) -> None:
    """As LeRobot's data sets of version 3 have them: their times each begin at 0."""
    numbers = {f"taxel_{k}": FRAMES.reshape(len(FRAMES), -1)[:, k] for k in range(24)}
    whose = np.arange(len(TIME)) % 2
    pl.DataFrame({"time": TIME, "episode_index": whose, **numbers}).write_parquet(tmp_path / "log.parquet")
    for named, found in (("episode = 1", np.flatnonzero(whose)), ("", None)):
        (tmp_path / "rig.toml").write_text(f"[time]\n{named}\n[skin]\n{SHEET}")
        layout = load_rig(tmp_path / "rig.toml").layout()
        if found is None:
            with pytest.raises(InputError, match=r"holds 2 episodes.*episode = 0 in the rig's \[time\]"):
                read_recording(tmp_path / "log.parquet", layout)
        else:
            np.testing.assert_array_equal(read_recording(tmp_path / "log.parquet", layout).time, TIME[found])
