"""Write the frames of one sheet of 6 x 4 taxels in the formats of makers and recorders, each with its own way."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
import polars as pl
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROWS, COLUMNS, COUNT, PITCH = 6, 4, 40, 0.005
RNG = np.random.default_rng(49)
XYZ = np.random.default_rng(50).integers(20_000, 40_000, (COUNT, ROWS, COLUMNS, 3)).astype(np.float64)
TIME = np.round(0.01 * np.arange(COUNT), 3)
FRAMES = RNG.integers(20_000, 40_000, (COUNT, ROWS, COLUMNS)).astype(np.float64)
FLAT = FRAMES.reshape(COUNT, -1)
CELLS = [(row, column) for row in range(ROWS) for column in range(COLUMNS)]
NUMBERS = range(ROWS * COLUMNS)
Write = Callable[[Path], None]


def table(
    names: Sequence[str], values: np.ndarray = FLAT, *, time: str = "time", more: Sequence[str] = (), sep: str = ","
) -> Write:
    """Return a writer of a table: a time, a column a name, and more columns that are no taxels."""
    extra = {"frame_id": range(COUNT), "sum": FLAT.sum(axis=1), "label": ["press"] * COUNT, "temp": [31.5] * COUNT}

    def write(path: Path) -> None:
        rows = [sep.join([*([time] if time else []), *names, *more])]
        for k, row in enumerate(values.reshape(len(values), -1)):
            fields = [*([f"{TIME[k]:.3f}"] if time else []), *(f"{each:.12g}" for each in row)]
            rows.append(sep.join([*fields, *(str(extra[name][k]) for name in more)]))
        path.write_text("\n".join([*rows, ""]))

    return write


def _sorted(names: Sequence[str], order: Iterable[int] | None = None) -> Write:
    """Return a writer of columns in the order of their names as texts, or in this order."""
    picked = list(order) if order is not None else sorted(NUMBERS, key=lambda k: names[k])
    return table([names[k] for k in picked], FLAT[:, picked])


def _long(names: str, keys: Callable[[int], str], *, shuffled: bool = False, lost: int = 0, scan: float = 0.0) -> Write:
    """Return a writer of a row a taxel, each so much later [s] than the one before."""

    def write(path: Path) -> None:
        rng, rows = np.random.default_rng(1), [names]
        for k in range(COUNT):
            order = rng.permutation(len(NUMBERS)) if shuffled else np.array(NUMBERS)
            kept = order[: len(order) - lost * (k == 5)].tolist()
            rows += [f"{TIME[k] + scan * j:.6g},{keys(i)},{FLAT[k, i]:g}" for j, i in enumerate(kept)]
        path.write_text("\n".join([*rows, ""]))

    return write


def _lists(text: Callable[[np.ndarray], str]) -> Write:
    def write(path: Path) -> None:
        rows = [f'{TIME[k]:.3f},"{text(FRAMES[k])}"' for k in range(COUNT)]
        path.write_text("\n".join(["timestamp,tactile", *rows, ""]))

    return write


def _blocks(label: Callable[[int], str], head: str = "") -> Write:
    def write(path: Path) -> None:
        frames = ["\n".join(",".join(f"{x:g}" for x in row) for row in frame) for frame in FRAMES]
        path.write_text(head + "\n".join(f"{label(k)}\n{frame}\n" for k, frame in enumerate(frames)))

    return write


def _npz(**arrays: np.ndarray) -> Write:
    return lambda path: np.savez(path, allow_pickle=False, **arrays)


def _parquet(frames: pl.Series) -> Write:
    counts = pl.Series("frame_index", range(COUNT))
    return lambda path: pl.DataFrame([pl.Series("timestamp", TIME), counts, frames]).write_parquet(path)


def _bag(kind: str, definitions: dict[str, str], message: Callable[[dict[str, type], int], object]) -> Write:
    """Return a writer of a bag with the definitions of its types."""

    def write(path: Path) -> None:
        store = get_typestore(Stores.ROS2_HUMBLE)
        for name, text in definitions.items():
            store.register(get_types_from_msg(text, name))
        with Writer(path, version=9) as bag:
            topic = bag.add_connection("/skin", kind, typestore=store)
            for k in range(COUNT):
                bag.write(topic, round(1e9 * TIME[k]) + 10**18, store.serialize_cdr(message(store.types, k), kind))

    return write


def _header(types: dict[str, type], k: int) -> object:
    stamp = types["builtin_interfaces/msg/Time"](sec=10**9, nanosec=round(1e9 * TIME[k]))
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id="pad")


def _multi_array(*sides: tuple[str, int], values: np.ndarray = FLAT) -> Write:
    def message(types: dict[str, type], k: int) -> object:
        dim = [types["std_msgs/msg/MultiArrayDimension"](label=label, size=size, stride=0) for label, size in sides]
        layout = types["std_msgs/msg/MultiArrayLayout"](dim=dim, data_offset=0)
        return types["std_msgs/msg/Float32MultiArray"](layout=layout, data=values[k].ravel().astype(np.float32))

    return _bag("std_msgs/msg/Float32MultiArray", {}, message)


_STATE, _PAD, _CELL = "tactile_msgs/msg/TactileState", "skin_msgs/msg/Pad", "skin_msgs/msg/Cell"
_OF_STATE = {_STATE: "std_msgs/Header header\nsensor_msgs/ChannelFloat32[] sensors\n"}
_OF_PAD = {
    _CELL: "string name\nuint8 status\nfloat64 pressure\n",
    _PAD: f"{_CELL.replace('/msg/', '/')}[] cells\nstring note\n",
}


def _state(types: dict[str, type], k: int) -> object:
    channel = types["sensor_msgs/msg/ChannelFloat32"](name="palm", values=FLAT[k].astype(np.float32))
    return types[_STATE](header=_header(types, k), sensors=[channel])


def _pad(types: dict[str, type], k: int) -> object:
    cells = [types[_CELL](name="c" * (1 + i % 3), status=1, pressure=float(FLAT[k, i])) for i in NUMBERS]
    return types[_PAD](cells=cells, note="")


def _members(types: dict[str, type], k: int) -> object:
    """Return a message with a list of taxels, whose members are in another order than the axes."""
    each = enumerate(XYZ[k].reshape(-1, 3).astype(int).tolist())
    taxels = [types[_TAXEL](id=i, z=z, x=x, y=y) for i, (x, y, z) in each]
    return types[_MODULES](modules=[types[_MODULE](name="m", taxels=taxels)])


def _xela(types: dict[str, type], k: int) -> object:
    return types["xela_msgs/msg/Xela"](header=_header(types, k), board_id=1, data=XYZ[k].ravel().astype(np.float32))


def _blocks_of_axes(names: Sequence[str]) -> Write:
    return table([f"{axis}{k}" for axis in names for k in NUMBERS], XYZ.reshape(COUNT, -1, 3).swapaxes(1, 2))


_MODULES, _MODULE, _TAXEL = "skin_msgs/msg/Modules", "skin_msgs/msg/Module", "skin_msgs/msg/Taxel"
_OF_MODULES = {
    _TAXEL: "int32 id\nuint16 z\nuint16 x\nuint16 y\n",
    _MODULE: "string name\nskin_msgs/Taxel[] taxels\n",
    _MODULES: "skin_msgs/Module[] modules\n",
}
_OF_XELA = {"xela_msgs/msg/Xela": "std_msgs/Header header\nint32 board_id\nfloat32[] data\n"}
_TEKSCAN = (
    "DATA_TYPE MOVIE\nROWS 6\nCOLS 4\nROW_SPACING 5 mm\nCOL_SPACING 5 mm\nSECONDS_PER_FRAME 0.01\nUNITS KPa\n"
    "ASCII_DATA @@\n\n"
)
_AREA = PITCH**2
RIGHT: dict[str, tuple[str, Write, float, float | None]] = {  # file, writer, newtons of a unit, rate that is given
    "as_texts": ("t.csv", _sorted([f"taxel_{k}" for k in NUMBERS]), 1.0, None),
    "from_one": ("t.csv", _sorted([f"S{k + 1}" for k in NUMBERS]), 1.0, None),
    "zeros_ahead": ("t.csv", _sorted([f"sensor1_taxel_{k:03d}" for k in NUMBERS], reversed(NUMBERS)), 1.0, None),
    "bare_numbers": ("t.csv", _sorted([str(k) for k in NUMBERS]), 1.0, None),
    "row_column": ("t.csv", _sorted([f"r{r}c{c}" for r, c in CELLS], sorted(NUMBERS, key=lambda k: k % 4)), 1.0, None),
    "capitals": ("t.csv", table([f"R{r + 1}C{c + 1}" for r, c in CELLS], more=("temp",)), 1.0, None),
    "column_first": ("t.csv", _sorted([f"c{c}_r{r}" for r, c in CELLS]), 1.0, None),
    "x_y": ("t.csv", _sorted([f"x{c}y{r}" for r, c in CELLS]), 1.0, None),
    "words": ("t.csv", _sorted([f"row {r} col {c}" for r, c in CELLS]), 1.0, None),
    "company": ("t.csv", table([f"taxel_{r}_{c}" for r, c in CELLS], more=("frame_id", "sum", "label")), 1.0, None),
    "indices": ("t.csv", table([f"data[{k}]" for k in NUMBERS], time="stamp"), 1.0, None),
    "echo": ("t.csv", table([f"field.data{k}" for k in NUMBERS], time="%time", more=("frame_id",)), 1.0, None),
    "kilopascals": ("t.csv", table([f"S{k + 1} [kPa]" for k in NUMBERS], time="Time (s)"), 1e3 * _AREA, None),
    "kpa_behind": ("t.csv", table([f"P{k + 1}_kPa" for k in NUMBERS], more=("sum",)), 1e3 * _AREA, None),
    "psi": ("t.csv", table([f"cell {k} (psi)" for k in NUMBERS]), 6894.757293168 * _AREA, None),
    "newtons": ("t.csv", table([f"cell {k} (N)" for k in NUMBERS]), 1.0, None),
    "millinewtons": ("t.csv", table([f"F{k} [mN]" for k in NUMBERS]), 1e-3, None),
    "kilograms": ("t.csv", table([f"taxel{k}_kg" for k in NUMBERS]), 9.80665, None),
    "volts": ("t.csv", table([f"A{k} [V]" for k in NUMBERS]), 1.0, None),
    "semicolons": ("t.csv", table([f"taxel_{k}" for k in NUMBERS], sep=";"), 1.0, None),
    "tabs": ("t.txt", table([f"taxel_{k}" for k in NUMBERS], sep="\t"), 1.0, None),
    "nameless": ("t.csv", lambda path: np.savetxt(path, FLAT, fmt="%g", delimiter=","), 1.0, 100.0),
    "nameless_time": ("t.csv", lambda path: np.savetxt(path, np.c_[TIME, FLAT], fmt="%.12g", delimiter=","), 1.0, None),
    "counter": ("t.csv", table([f"p{k}" for k in NUMBERS], time="", more=("frame_id",)), 1.0, 100.0),
    "list": ("t.csv", _lists(lambda frame: str(frame.ravel().tolist())), 1.0, None),
    "nested_list": ("t.csv", _lists(lambda frame: str(frame.tolist())), 1.0, None),
    "printed": ("t.csv", _lists(lambda frame: "[" + " ".join(f"{x:g}." for x in frame.ravel()) + "]"), 1.0, None),
    "long": ("t.csv", _long("time,taxel,value", str), 1.0, None),
    "long_shuffled": ("t.csv", _long("time,sensor_id,pressure", lambda i: str(i + 1), shuffled=True), 1.0, None),
    "long_cells": ("t.csv", _long("t,row,col,raw", lambda i: f"{CELLS[i][0]},{CELLS[i][1]}"), 1.0, None),
    "long_scanned": ("t.csv", _long("time,taxel,value", str, scan=1e-4), 1.0, None),
    "long_lost": ("t.csv", _long("time,taxel,value", str, lost=1), 1.0, None),
    "tekscan": ("t.asf", _blocks(lambda k: f"Frame {k + 1}", _TEKSCAN), 1e3 * _AREA, None),
    "blocks": ("t.txt", _blocks(lambda k: ""), 1.0, 100.0),
    "blocks_timed": ("t.txt", _blocks(lambda k: f"# t = {TIME[k]:.3f} s"), 1.0, None),
    "npz_key": ("t.npz", _npz(timestamps=TIME, tactile=FRAMES), 1.0, None),
    "npz_flat": ("t.npz", _npz(t=TIME, pressure=FLAT), 1.0, None),
    "npz_channel": ("t.npz", _npz(time=TIME, frames=FRAMES[..., None]), 1.0, None),
    "npy": ("t.npy", lambda path: np.save(path, FRAMES), 1.0, 100.0),
    "parquet_list": ("t.parquet", _parquet(pl.Series("observation.tactile", FLAT.tolist())), 1.0, None),
    "parquet_array": ("t.parquet", _parquet(pl.Series("observation.tactile", FRAMES)), 1.0, None),
    "parquet_wide": (
        "t.parquet",
        lambda path: pl.DataFrame({"time": TIME, **{f"taxel_{k}": FLAT[:, k] for k in NUMBERS}}).write_parquet(path),
        1.0,
        None,
    ),
    "multi_array": ("bag", _multi_array(("row", 6), ("column", 4)), 1.0, None),
    "tactile_state": ("bag", _bag(_STATE, _OF_STATE, _state), 1.0, None),
    "cells_of_messages": ("bag", _bag(_PAD, _OF_PAD, _pad), 1.0, None),
}
"""Formats that hold enough: each is read as `FRAMES`, times the force of a unit."""
_TAXELS = XYZ.reshape(COUNT, -1, 3)
_SHUFFLED = np.random.default_rng(2).permutation(72)
THREE: dict[str, tuple[str, Write]] = {  # file, writer
    "axes": ("t.csv", table([f"{k + 1}_{axis}" for k in NUMBERS for axis in "xyz"], XYZ)),
    "axes_blocks": ("t.csv", _blocks_of_axes("XYZ")),
    "axes_forces": ("t.csv", table([f"p{k}_f{axis}_N" for k in NUMBERS for axis in "xyz"], XYZ, more=("temp",))),
    "axes_cells": ("t.csv", table([f"r{r}c{c}_{axis}" for r, c in CELLS for axis in "xyz"], XYZ)),
    "axes_shuffled": (
        "t.csv",
        table([f"{k // 3 + 1}_{'xyz'[k % 3]}" for k in _SHUFFLED], XYZ.reshape(COUNT, -1)[:, _SHUFFLED]),
    ),
    "axes_array": ("t.npz", _npz(time=TIME, frames=XYZ)),
    "axes_taxels": ("t.npz", _npz(time=TIME, tactile=_TAXELS)),
    "axes_first": ("t.npz", _npz(time=TIME, tactile=_TAXELS.swapaxes(1, 2))),
    "axes_images": ("t.npz", _npz(time=TIME, tactile=np.moveaxis(XYZ, 3, 1))),
    "axes_nested_list": ("t.parquet", _parquet(pl.Series("observation.tactile", _TAXELS))),
    "axes_layout": ("bag", _multi_array(("taxel", 24), ("axis", 3), values=XYZ)),
    "axes_layout_first": ("bag", _multi_array(("axis", 3), ("taxel", 24), values=_TAXELS.swapaxes(1, 2))),
    "axes_members": ("bag", _bag(_MODULES, _OF_MODULES, _members)),
    "axes_xela": ("bag", _bag("xela_msgs/msg/Xela", _OF_XELA, _xela)),
}
"""Formats with three numbers a taxel: each is read as `XYZ`."""
REFUSED: dict[str, tuple[str, Write, str]] = {  # file, writer, words of the reason
    "npy_wrenches": ("t.npy", lambda path: np.save(path, FLAT[:, :11]), r"no.* log of any of.*rows of 11.*savez"),
    "plate": ("t.csv", table([f"pad{k}_kg" for k in range(4)], FLAT[:, :4]), "single-axis cells.*load_cells"),
    "untimed": ("t.csv", table([f"taxel_{k}" for k in NUMBERS], time=""), "Add --rate HZ"),
}
"""Formats that are refused with the reason."""
