"""Keep some long pieces of a log of any length."""

from __future__ import annotations

from palpate.files.logs import join
from palpate.signals.recording import Recording


class Excerpt:
    """An excerpt of a log: pieces of consecutive samples, as steps and spectra need neighbours.

    Args:
        most: number of samples above which `stride` is doubled.
        piece: samples of a piece.

    Attributes:
        count: number of samples added.
        stride: one piece in so many is kept.
    """

    def __init__(self, most: int = 1 << 18, piece: int = 1 << 13) -> None:
        self.count, self.stride, self._most, self._piece = 0, 1, most, piece
        self._kept: list[tuple[int, Recording]] = []  # with the number of the piece that it is of

    def add(self, block: Recording) -> None:
        """Add the next samples, in blocks of any size."""
        start = 0
        while start < len(block):
            number, inside = divmod(self.count, self._piece)
            end = min(len(block), start + self._piece - inside)
            if number % self.stride == 0:
                self._keep(number, block.picked(slice(start, end)))
            self.count += end - start
            start = end

    def recording(self) -> Recording:
        """Return the kept samples as a `Recording`, with gaps between the pieces.

        Raises:
            IndexError: no sample was added.
        """
        return join([part for _, part in self._kept])

    def _keep(self, number: int, part: Recording) -> None:
        self._kept.append((number, part))
        while sum(len(one) for _, one in self._kept) > self._most and self.stride < 2 * self.count:
            self.stride *= 2
            self._kept = [one for one in self._kept if one[0] % self.stride == 0]
