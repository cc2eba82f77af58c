"""Convert contacts to the columns of a data set, one row for each of its rows, with their statistics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.table import LABELS
from palpate.errors import InputError

PREFIX = "observation.contact."
Columns = Mapping[str, np.ndarray]
_AXES = ("x", "y", "z")
_NAMES = {
    "count": ("count",),
    "status": ("status",),
    "point": _AXES,
    "force": _AXES,
    "covariance": ("xx", "xy", "xz", "yy", "yz", "zz"),
}
_INTEGERS = ("count", "status")
_UPPER = np.triu_indices(3)
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


def contact_features(frame: str) -> dict[str, dict[str, Any]]:
    """Return the features of meta/info.json for contacts in a coordinate frame: name -> dtype, shape, names, info."""
    info: dict[str, dict[str, object]] = {
        "count": {"of": "contacts in this row; without one the other columns but status are 0"},
        "status": {"codes": LABELS},
        "point": {"unit": "m", "frame": frame, "of": "the contact with the largest force"},
        "force": {"unit": "N", "frame": frame},
        "covariance": {"unit": "m^2", "frame": frame, "of": "the point"},
    }
    return {
        f"{PREFIX}{name}": {
            "dtype": "int64" if name in _INTEGERS else "float32",
            "shape": [len(names)],
            "names": list(names),
            "info": info[name],
        }
        for name, names in _NAMES.items()
    }


def contact_columns(contacts: Contacts, count: int, where: str) -> dict[str, np.ndarray]:
    """Return the columns, name -> (count, k), of a log with `count` samples: in each row the largest contact.

    Without a contact all but the status are 0; a covariance that is not known is NaN. `where` is the file of the
    contacts.

    Raises:
        InputError: the contacts are those of another number of samples.
    """
    estimate, sample = contacts.estimate, contacts.sample
    if len(seen := np.unique(sample)) != count or (count and seen[-1] != count - 1):
        raise InputError(f"holds contacts of {len(seen)} samples, but the episode has {count} rows.", where=where)
    answered = estimate.answered
    force = np.where(answered, np.nan_to_num(np.linalg.norm(estimate.force, axis=1)), -1.0)
    order = np.lexsort((force, sample))
    largest = order[np.append(np.diff(sample[order]) > 0, True)[: len(order)]]  # the last one of each sample
    found = answered[largest, None]
    return {
        "count": np.bincount(sample[answered], minlength=count)[:, None].astype(np.int64),
        "status": np.asarray(estimate.status)[largest, None].astype(np.int64),
        "point": np.where(found, estimate.point[largest], 0.0).astype(np.float32),
        "force": np.where(found, estimate.force[largest], 0.0).astype(np.float32),
        "covariance": np.where(found, estimate.covariance[:, *_UPPER][largest], 0.0).astype(np.float32),
    }


def statistics(columns: Columns) -> dict[str, dict[str, np.ndarray]]:
    """Return name of each column with `PREFIX` -> name of each statistic -> (k,), of the rows that are known."""
    return {f"{PREFIX}{name}": _statistics(values) for name, values in columns.items()}


def _statistics(values: Float[np.ndarray, "n k"] | Int[np.ndarray, "n k"]) -> dict[str, np.ndarray]:
    known = values[np.isfinite(values).all(axis=1)]
    known = known if len(known) else np.zeros_like(values[:1])
    return {
        "min": known.min(axis=0),
        "max": known.max(axis=0),
        "mean": known.mean(axis=0, dtype=np.float64),
        "std": known.std(axis=0, dtype=np.float64),
        "count": np.array([len(values)]),
        **{key: np.quantile(known, share, axis=0) for key, share in _QUANTILES.items()},
    }


def joined(parts: Sequence[Mapping[str, Mapping[str, np.ndarray]]]) -> dict[str, dict[str, np.ndarray]]:
    """Return the statistics of all episodes from those of each; quantiles, as LeRobot's own, are weighted means."""
    return {name: _joined([part[name] for part in parts]) for name in parts[0]}


def _joined(parts: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    weight = np.array([part["count"] for part in parts], dtype=np.float64)

    def mean(values: Iterable[np.ndarray]) -> np.ndarray:
        return (weight * np.array(list(values))).sum(axis=0) / weight.sum()

    center = mean(part["mean"] for part in parts)
    variance = mean(part["std"] ** 2 + (part["mean"] - center) ** 2 for part in parts)
    return {
        "min": np.min([part["min"] for part in parts], axis=0),
        "max": np.max([part["max"] for part in parts], axis=0),
        "mean": center,
        "std": np.sqrt(variance),
        "count": np.sum([part["count"] for part in parts], axis=0),
        **{key: mean(part[key] for part in parts) for key in _QUANTILES},
    }
