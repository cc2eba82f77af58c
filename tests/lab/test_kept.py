"""What takes long to make is kept: used where it is of the same inputs and code, made anew where it is not."""

from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from palpate_lab.cli import kept as keeping
from palpate_lab.cli.kept import kept


def table() -> np.ndarray:
    return np.arange(12.0).reshape(3, 4)


def skin(inputs: int, make: Mock) -> np.ndarray:
    """What is kept for these inputs."""

    def write(path: Path, value: np.ndarray) -> None:
        with path.open("wb") as file:
            np.savez(file, table=value)

    def read(path: Path) -> np.ndarray:
        with path.open("rb") as file, np.load(file) as arrays:
            return arrays["table"]

    return kept("skin.npz", inputs, make, write, read)


@pytest.fixture
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    both = tmp_path / "package", tmp_path / "user"
    monkeypatch.setattr(keeping, "_folders", lambda: both)
    monkeypatch.setattr(keeping, "PACKAGES", [tmp_path / "code"])
    (tmp_path / "code").mkdir()
    return both


def test_a_second_run_makes_nothing_and_has_the_same_to_the_last_bit(folders: tuple[Path, Path]) -> None:
    make = Mock(side_effect=table)
    first, second = skin(7, make), skin(7, make)
    assert make.call_count == 1
    np.testing.assert_array_equal(second, first, strict=True)
    assert len(list(folders[0].iterdir())) == 1


def test_other_inputs_and_other_code_make_it_anew(folders: tuple[Path, Path], tmp_path: Path) -> None:
    make = Mock(side_effect=table)
    skin(7, make)
    skin(8, make)
    assert make.call_count == 2
    (tmp_path / "code/barrel.py").write_text("STIFFNESS = 2\n")
    skin(8, make)
    assert make.call_count == 3
    assert len(list(folders[0].iterdir())) == 1  # what was kept before is gone


@pytest.mark.parametrize("damage", ["empty", "cut", "flipped", "another file"])
def test_a_damaged_file_is_made_anew(folders: tuple[Path, Path], damage: str) -> None:
    make = Mock(side_effect=table)
    skin(7, make)
    (file,) = folders[0].iterdir()
    whole = file.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 1
    file.write_bytes({"empty": b"", "cut": whole[:-5], "flipped": bytes(flipped), "another file": b"PK" * 99}[damage])
    skin(7, make)
    assert make.call_count == 2
    assert file.read_bytes() == whole


def test_without_a_folder_to_write_into_nothing_is_kept(folders: tuple[Path, Path]) -> None:
    """Files in the place of the folders: a test that runs as root may write into any folder."""
    make = Mock(side_effect=table)
    folders[0].touch()
    skin(7, make)
    (file,) = folders[1].iterdir()  # the user's
    file.unlink()
    folders[1].rmdir()
    folders[1].touch()
    assert len(skin(7, make)) == 3
    assert make.call_count == 2
