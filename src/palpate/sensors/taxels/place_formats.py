"""Read and write files of taxel places: the model (.toml), iCub's positions (.txt), tables (.csv) or frames (.urdf).

The content of a file decides how it is read, the suffix how it is written.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.files.atomic import write_text
from palpate.files.inputs import open_input, read_some
from palpate.files.logs.numbering import numbered_alike
from palpate.files.models import read_model, write_model
from palpate.files.tables.stated import Stated
from palpate.files.units import split_unit
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.skin_map.files import fixed_frame
from palpate.surfaces.mesh import UNITS

if TYPE_CHECKING:
    from palpate.files.tables.table import TextTable

_PLACES = ("x", "y", "z")
_NORMALS = ("nx", "ny", "nz")
_IDS = ("id", "taxel", "taxel_id", "index", "number", "cell", "channel", "name")  # of the column that says which it is
_MODULE = 12  # numbers of a module in iCub's files
_PAD, _NONE = -2, -1  # in taxel2Repr: a thermal pad, no module
_REPRESENTS = 3  # which taxel of a module stands for it there
_MOST = 1_000_000  # largest id of a taxel
_LARGEST = 10.0  # m: no skin of a robot is larger
_FLAT = 1e-3  # m: taxels that face one way lie in one plane, or the normals are not meant
_NUMBER = rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_PLAIN = re.compile(rb"\s*" + rb"\s+".join([_NUMBER] * 6) + rb"\s*")
_NAMED = re.compile(rb"\s*(?:name\s|spatial_sampling\s|taxel2Repr\b|\[calibration\])")


def read_taxel_places(path: str | Path) -> TaxelPlaces:
    """Return the `TaxelPlaces` of a file: the model, iCub's positions, a table, or a URDF's frames.

    A table has columns x, y, z and, where known, nx, ny, nz and module, in metres or a unit that it states (`x [mm]`,
    `x_mm`). A column id (or taxel, taxel_id, index, number, cell, channel, name) orders the taxels: ids from 0 are
    their indices, others are taken by size; of a name its numbers count. In iCub's files rows of zeros are no taxel;
    normals that are zero, or equal all over a body that is not flat, are not known.

    Raises:
        InputError: the file cannot be read, is of another kind, has a row, id, module or unit that cannot be used, no
            taxels, or taxels over 10 m from each other.
    """
    path = Path(path)
    with open_input(path) as file:
        content = read_some(file, path, -1).removeprefix(b"\xef\xbb\xbf")
    first = next((line for line in content.splitlines() if line.strip()), b"")
    if not first:
        raise InputError("is empty.", where=str(path))
    if path.suffix.lower() == ".toml" or re.match(rb"#|kind\s*=", first):
        places = read_model(path, TaxelPlaces)
    elif first.lstrip().startswith(b"<"):
        places = _read_urdf(content, path)
    elif _NAMED.match(first) or _PLAIN.fullmatch(first):
        places = _read_icub(content, path)
    else:
        places = _read_table(path)
    return _checked(places, path)


def holds_taxels(path: Path) -> bool:
    """Return whether a file other than TOML looks like taxel places, and not like a log.

    Raises:
        InputError: the file cannot be read.
    """
    with open_input(path) as file:
        head = read_some(file, path, 1 << 20).removeprefix(b"\xef\xbb\xbf")
    lines = [line for line in head.splitlines() if line.strip()]
    if not lines or b"\0" in head[:4096]:
        return False
    if lines[0].lstrip().startswith(b"<"):
        return b"<robot" not in head and re.search(rb"_taxel_\d+\"", head) is not None
    if _NAMED.match(lines[0]):
        return b"[calibration]" in head
    if all(_PLAIN.fullmatch(line) for line in lines[:_MODULE]):
        try:
            rows = _rows(head.decode(errors="replace"), 0, path)
        except InputError:
            return False
        with np.errstate(over="ignore"):  # numbers of nonsense are no normals
            length = np.linalg.norm(rows[:, 3:], axis=1)
        return bool(len(rows) % _MODULE == 0 and ((length == 0) | (np.abs(length - 1.0) < 0.6)).all())
    names = {_unit(name.strip())[0].lower() for name in re.split(r"[,;\t]", lines[0].decode(errors="replace"))}
    return {*_PLACES} <= names <= {*_PLACES, *_NORMALS, "module", *_IDS}


def require_suffix(path: Path) -> None:
    """Check that a path has a suffix with which places can be written: .toml, .csv, .txt or .urdf.

    Raises:
        InputError: it is none of those.
    """
    if path.suffix.lower() not in _SUFFIXES:
        hint = f"Use {', '.join(_SUFFIXES)}."
        raise InputError(f"cannot write places of taxels as {path.suffix!r}.", where=str(path), hint=hint)


def write_taxel_places(path: str | Path, places: TaxelPlaces, *, name: str = "skin") -> None:
    """Write taxel places in the format of the suffix; all but .toml store only places, normals and modules.

    Args:
        path: .toml, .txt, .csv or .urdf.
        places: to write.
        name: of the skin's part, in iCub's file and in the URDF's links; "" for iCub's bare rows.

    Raises:
        InputError: another suffix, or the file cannot be written.
    """
    path = Path(path)
    require_suffix(path)
    if path.suffix.lower() == ".toml":
        write_model(path, places)
    else:
        write_text(path, _WRITERS[path.suffix.lower()](places, name))


def _checked(places: TaxelPlaces, path: Path) -> TaxelPlaces:
    """Return the places; raise an InputError if there are none, or the skin is larger than 10 m."""
    there = places.positions[places.there]
    if not len(there):
        raise InputError("has no taxels.", where=str(path))
    across = float(np.ptp(there, axis=0).max())
    if across > _LARGEST:
        raise InputError(
            f"has taxels up to {across:.3g} m from each other, which is too far.",
            where=str(path),
            hint="Write the numbers in metres; a table may state another unit, as x [mm].",
        )
    return places


def _read_icub(content: bytes, path: Path) -> TaxelPlaces:
    """Read bare rows, or rows below [calibration] with taxel2Repr, their modules, above."""
    text = content.decode("utf-8", errors="replace")
    head, named, body = text.partition("[calibration]")
    offset = len(head.splitlines()) if named else 0
    rows = _rows(body if named else text, offset, path)
    match = re.search(r"taxel2Repr\s*\(([^)]*)\)", head) if named else None
    there = (rows[:, :3] != 0).any(axis=1)
    if match is None:
        groups = np.where(there, np.arange(len(rows)) // _MODULE, -1)
    else:
        try:
            groups = np.array([int(part) for part in match[1].split()], dtype=np.int64)
        except (ValueError, OverflowError) as problem:
            raise InputError("taxel2Repr must be whole numbers.", where=str(path)) from problem
        if len(groups) < len(rows) or (groups[len(rows) :] >= 0).any():  # it may go on with numbers of no taxel
            what = f"has {len(rows)} rows of taxels, but taxel2Repr has {len(groups)} numbers."
            raise InputError(what, where=str(path), hint="Write in taxel2Repr one number for each row.")
        groups = groups[: len(rows)]
        there &= groups >= 0
    positions = np.where(there[:, None], rows[:, :3], np.nan)
    module = _numbered(np.where(there, groups, -1), own=match is not None)
    normals, notes = _unit_normals(positions, np.where(there[:, None], rows[:, 3:], np.nan))
    return TaxelPlaces(positions, normals, module=module, notes=notes)


def _rows(text: str, offset: int, path: Path) -> Float[np.ndarray, "k 6"]:
    """Read six numbers (k, 6) from each line, until the next section."""
    found = list[list[float]]()
    for number, line in enumerate(text.splitlines(), start=offset + (0 if offset else 1)):
        parts = line.split("#", 1)[0].split()
        if not parts:
            continue
        if parts[0].startswith("["):
            break
        try:
            values = [float(part) for part in parts]
        except ValueError:
            values = []
        if len(values) != 6 or not np.isfinite(values).all():
            raise InputError("must be six numbers, x y z nx ny nz.", where=f"{path}, line {number}")
        found.append(values)
    return np.array(found, dtype=np.float64).reshape(-1, 6)


def _numbered(groups: Int[np.ndarray, " k"], *, own: bool) -> Int[np.ndarray, " k"]:
    """Return module indices from 0; `own`: a taxel that represents only itself is on no module."""
    known = np.unique(groups[groups >= 0])
    if own:
        alone = [group for group in known.tolist() if group < len(groups) and (groups == group).sum() == 1]
        known = np.setdiff1d(known, [group for group in alone if groups[group] == group])
    module = np.searchsorted(known, groups)
    return np.where(np.isin(groups, known), module, -1)


def _unit_normals(
    positions: Float[np.ndarray, "k 3"], normals: Float[np.ndarray, "k 3"]
) -> tuple[Float[np.ndarray, "k 3"], tuple[str, ...]]:
    """Return unit normals and notes; NaN where a normal is 0, or where all are equal on a skin that is not flat."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(normals, axis=1, keepdims=True)
    unit = np.divide(normals, length, out=np.full_like(normals, np.nan), where=(length > 0) & np.isfinite(length))
    known = np.isfinite(unit).all(axis=1)
    if np.count_nonzero(known) > 1:
        one = unit[known][0]
        deep = float(np.ptp(positions[known] @ one))
        if np.abs(unit[known] - one).max() < 1e-9 and deep > _FLAT:
            said = f"all normals are ({', '.join(f'{part + 0.0:g}' for part in one)})"
            why = f"though the taxels extend {1e3 * deep:.3g} mm along it: the normals are not used"
            return np.full_like(unit, np.nan), (f"{said}, {why}",)
    return unit, ()


def _read_table(path: Path) -> TaxelPlaces:
    """Read the columns x, y, z[, nx, ny, nz][, module][, id]."""
    from palpate.files.tables.table import read_table  # here: it loads polars

    table = read_table(path)
    parts = {name: _unit(name) for name in reversed(table.names)}
    columns = {bare.strip().lower(): name for name, (bare, _) in parts.items()}
    if not columns.keys() >= set(_PLACES):
        raise InputError(
            f"has no places of taxels: its columns are {', '.join(table.names[:12])}.",
            where=str(path),
            hint="Give columns x,y,z[,nx,ny,nz][,module][,id], iCub's x y z nx ny nz, or a model of `palpate calibrate "
            "taxels`.",
        )
    stated = Stated.of_dialect(table.dialect).units
    units = [stated.get(columns[name]) or parts[columns[name]][1] or "m" for name in _PLACES]
    if len({*units}) > 1 or units[0] not in UNITS:
        hint = f"Write one of {', '.join(UNITS)}, the same for all three."
        raise InputError(f"x, y, z must be in one known unit, not in {', '.join(units)}.", where=str(path), hint=hint)
    positions = UNITS[units[0]] * table.numbers([columns[name] for name in _PLACES], strict=True)[0]
    if (endless := np.isinf(positions).any(axis=1)).any():
        table.refuse(int(np.argmax(endless)), "x, y, z must be finite numbers")
    normals = np.full_like(positions, np.nan)
    if columns.keys() >= set(_NORMALS):
        normals = table.numbers([columns[name] for name in _NORMALS], strict=True)[0]
    module = np.full(len(positions), -1)
    if "module" in columns:
        given = np.nan_to_num(table.numbers([columns["module"]], strict=True)[0][:, 0], nan=-1.0)
        odd = (given != np.round(given)) | (given < -1) | (given > _MOST)
        if odd.any():
            table.refuse(int(np.argmax(odd)), f"module must be a whole number up to {_MOST:,}, -1: none")
        module = given.astype(np.int64)
    named = next((columns[name] for name in _IDS if name in columns), None)
    index, ids = (np.arange(len(positions)), None) if named is None else _ordered(table, named)
    count = int(index.max(initial=-1)) + 1
    placed, facing, of = np.full((count, 3), np.nan), np.full((count, 3), np.nan), np.full(count, -1)
    placed[index], facing[index], of[index] = positions, normals, module
    facing, notes = _unit_normals(placed, facing)
    return TaxelPlaces(placed, facing, module=of, notes=notes, ids=ids)


def _unit(name: str) -> tuple[str, str]:
    """Return quantity and unit of a column's name, of `x_mm` and `x mm` too."""
    match = re.fullmatch(rf"([xyz])[ _]({'|'.join(UNITS)})", name.strip(), re.IGNORECASE)
    return (match[1], match[2].lower()) if match else split_unit(name)


def _ordered(table: TextTable, name: str) -> tuple[Int[np.ndarray, " n"], tuple[int, ...]]:
    """Return the index (n,) of each row's taxel, its id if ids begin at 0, else its rank; and the id of each index."""
    ids = _ids(table, name)
    values, first, index = np.unique(ids, return_index=True, return_inverse=True)
    if len(values) < len(ids):
        twice = np.setdiff1d(np.arange(len(ids)), first)
        table.refuse(int(twice[0]), f"{name} {ids[twice[0]]} names two taxels")
    if values[:1].tolist() == [0]:
        return ids, tuple(range(int(values[-1]) + 1))
    return np.asarray(index, dtype=np.int64).ravel(), tuple(values.tolist())


def _ids(table: TextTable, name: str) -> Int[np.ndarray, " n"]:
    """Return the ids (n,) in a column: whole numbers, or the numbers in names that are numbered alike."""
    texts = table.strings(name).to_list()
    groups = numbered_alike(text for text in texts if text)
    if len(groups) == 1 and groups[0].pattern != "*" and len(groups[0].names) == len(texts):
        ordered = groups[0].ordered()
        single = dict(zip(groups[0].names, groups[0].numbers, strict=True))
        numbers = (single[text][0] if len(single[text]) == 1 else ordered.index(text) for text in texts)
        ids = np.array([min(number, _MOST + 1) for number in numbers], dtype=np.float64)
    else:
        ids = table.numbers([name], strict=True)[0][:, 0]
    odd = ~(ids == np.round(ids)) | (ids < 0) | (ids > _MOST)  # NaN too
    if odd.any():
        table.refuse(int(np.argmax(odd)), f"{name} must be a whole number from 0 to {_MOST:,}")
    return ids.astype(np.int64)


def _read_urdf(content: bytes, path: Path) -> TaxelPlaces:
    """Read fixed frames of taxels, z outward, numbered by their names."""
    try:
        root = ElementTree.fromstring(b"<fragment>" + re.sub(rb"<\?xml.*?\?>", b"", content) + b"</fragment>")
    except ElementTree.ParseError as problem:
        raise InputError(f"cannot be read as XML ({problem}).", where=str(path)) from problem
    numbered = dict[int, tuple[np.ndarray, int]]()
    for joint in root.iter("joint"):
        child, origin = joint.find("child"), joint.find("origin")
        match = re.fullmatch(r".*?(?:_module_(\d+))?_taxel_(\d+)", "" if child is None else child.get("link", ""))
        if joint.get("type") != "fixed" or match is None or origin is None:
            continue
        if max(float(digits or 0) for digits in match.groups()) > _MOST:
            what = f"link {match[0]!r} has a number beyond {_MOST:,}."
            raise InputError(what, where=str(path), hint="Number modules and taxels from 0.")
        try:
            six = [float(part) for key in ("xyz", "rpy") for part in origin.get(key, "0 0 0").split()]
            if not np.isfinite(six).all():
                raise ValueError("not finite")
            numbered[int(match[2])] = np.array(six).reshape(2, 3), int(match[1] or -1)
        except ValueError as problem:
            raise InputError(
                f"joint {joint.get('name')!r} has an <origin> that cannot be read: xyz and rpy are three numbers each.",
                where=str(path),
            ) from problem
    if not numbered:
        raise InputError("has no frames of taxels.", where=str(path), hint="Name their links ..._taxel_0, ..._taxel_1.")
    positions, normals = np.full((2, max(numbered) + 1, 3), np.nan)
    module = np.full(len(positions), -1)
    for number, ((xyz, (roll, pitch, yaw)), of) in numbered.items():
        positions[number], module[number] = xyz, of
        cosine, sine = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
        normals[number] = (
            cosine[2] * sine[1] * cosine[0] + sine[2] * sine[0],
            sine[2] * sine[1] * cosine[0] - cosine[2] * sine[0],
            cosine[1] * cosine[0],
        )
    normals, notes = _unit_normals(positions, normals)
    return TaxelPlaces(positions, normals, module=module, notes=notes)


def _icub(places: TaxelPlaces, name: str) -> str:
    """Return [calibration] of iCub's skinManager; rows of zeros are no taxel."""
    table = np.nan_to_num(np.concatenate([places.positions, places.normals], axis=1))
    table[~places.there] = 0.0
    rows = [" ".join(f"{number:.9f}" for number in row) for row in table]
    if not name:
        return "\n".join([*rows, ""])
    numbers = " ".join(map(str, _represented(places).tolist()))
    head = [f"name {name}", "spatial_sampling taxel", f"taxel2Repr ({numbers})", "[calibration]"]
    return "\n".join([*head, *rows, ""])


def _represented(places: TaxelPlaces) -> Int[np.ndarray, " k"]:
    """Return the taxel that represents each taxel's module, itself on no module."""
    module = np.where(places.there, places.module, -1)
    found = np.where(places.there, np.arange(len(places)), _NONE)
    for number in np.unique(module[module >= 0]):
        rows = np.flatnonzero(module == number)
        found[rows] = rows[min(_REPRESENTS, len(rows) - 1)]
    whole = np.arange(len(places)) // _MODULE
    inside = np.isin(whole, np.unique(whole[places.there & (places.module >= 0)]))
    return np.where((found == _NONE) & inside, _PAD, found)


def _csv(places: TaxelPlaces, name: str) -> str:
    header = ",".join([*_PLACES, *_NORMALS, "module"])
    rows = [
        ",".join(repr(float(number)) for number in (*point, *normal)) + f",{module}"
        for point, normal, module in zip(places.positions, places.normals, places.module.tolist(), strict=True)
    ]
    return "\n".join([header, *rows, ""])


def _urdf(places: TaxelPlaces, name: str) -> str:
    """Return a fixed frame for each taxel, z along its normal."""
    lines = [f"<!-- Taxels of {name}: put these into the robot and name the link that carries them. -->"]
    for number in np.flatnonzero(places.there).tolist():
        normal = places.normals[number]
        normal = normal if np.isfinite(normal).all() else np.array([0.0, 0.0, 1.0])
        along = np.eye(3)[np.argmin(np.abs(normal))]
        module = f"_module_{places.module[number]}" if places.module[number] >= 0 else ""
        lines += fixed_frame(f"{name}{module}_taxel_{number}", places.positions[number], normal, along)
    return "\n".join([*lines, ""])


_WRITERS: Mapping[str, Callable[[TaxelPlaces, str], str]] = {".csv": _csv, ".txt": _icub, ".urdf": _urdf}
_SUFFIXES = (".toml", *_WRITERS)
