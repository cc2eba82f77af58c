"""Let `palpate batch` estimate the episodes of a LeRobot data set, and write a copy with contacts as columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from palpate.console.console import announce, note
from palpate.errors import InputError
from palpate.files.datasets import Dataset, Episode, is_dataset, read_dataset, write_labelled
from palpate.setup import Rig
from palpate.setup.tables import RigTime

CONTACTS = "contacts"  # folder in the output, of the files of contacts


@dataclass(frozen=True)
class EpisodeLog:
    """An episode as a log of its own: its data set, without the list of its episodes, and its place there."""

    data: Dataset
    episode: Episode

    @property
    def path(self) -> Path:
        """Absolute path of the file with its rows."""
        return self.data.root / self.episode.file

    @property
    def name(self) -> str:
        """Name of its contacts, without a suffix."""
        return f"{CONTACTS}/episode_{self.episode.index:06d}"

    @property
    def called(self) -> str:
        """Words for a person."""
        return f"episode {self.episode.index} ({self.episode.file})"

    def rig(self, rig: Rig) -> Rig:
        """Return the rig that reads this episode alone, by the data set's times unless the rig names others.

        Raises:
            InputError: the file has not the rows that the data set states.
        """
        self.data.require_rows(self.episode)
        time = RigTime(**self.data.time) if rig.time == RigTime() else rig.time
        return replace(rig, time=replace(time, episode=self.episode.index))


def episodes_of(given: Sequence[Path], output: Path) -> list[EpisodeLog]:
    """Return the episodes of the data set that is given; [] where logs are given.

    Raises:
        InputError: it is not given alone, cannot be read, or contains the output.
    """
    found = [path for path in given if is_dataset(path)]
    if not found:
        return []
    root = found[0]
    if len(given) > 1:
        raise InputError("is a data set, which is labelled alone.", where=str(root), hint="Give it without other logs.")
    if root.resolve() in (output.resolve(), *output.resolve().parents):
        what = "is the data set or in it, and a copy is written."
        raise InputError(what, where=str(output), hint="Name another folder with -o FOLDER.")
    data = read_dataset(root)
    alone = replace(data, root=root.absolute(), episodes=())  # another process may be in another folder
    return [EpisodeLog(alone, each) for each in data.episodes]


def label(logs: Sequence[EpisodeLog], contacts: Mapping[int, Path], output: Path, frame: str) -> None:
    """Write the copy of a data set with its contacts; without those of all episodes only say so.

    Raises:
        InputError: a file cannot be read or written, or contacts are of other rows.
    """
    if missing := len(logs) - len(contacts):
        note([f"the data set is not written: {missing} of {len(logs)} episodes have no contacts"], kind="warning")
        return
    announce(f"writing the data set with its contacts to {output}")
    data = replace(logs[0].data, episodes=tuple(each.episode for each in logs))
    write_labelled(data, contacts, output, frame)
