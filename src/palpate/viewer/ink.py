"""Draw strokes and text into pictures with OpenCV, without a screen."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.spatial.arguments import takes_arrays

__all__: list[str] = []  # for this package alone

_SHIFT = 4  # bits of a fraction of a pixel


@takes_arrays
class Ink:
    """OpenCV's strokes and text, with colours (red, green, blue) and places in fractions of a pixel."""

    def __init__(self, cv2: Any) -> None:
        self._cv2: Any = cv2
        self._font: int = cv2.FONT_HERSHEY_SIMPLEX

    def area(self, picture: np.ndarray, corners: Float[np.ndarray, "k 2"], shade: tuple[int, int, int]) -> None:
        """Draw a filled polygon with these corners [px].

        Raises:
            InputError: corners has another shape.
        """
        self._cv2.fillPoly(picture, [_fixed(corners)], shade[::-1], self._cv2.LINE_AA, _SHIFT)

    def loop(self, picture: np.ndarray, corners: np.ndarray, shade: tuple[int, int, int], thick: int) -> None:
        """Draw a closed line through the corners [px], `thick` pixels wide."""
        self._cv2.polylines(picture, [_fixed(corners)], True, shade[::-1], thick, self._cv2.LINE_AA, _SHIFT)

    def line(self, picture: np.ndarray, points: np.ndarray, shade: tuple[int, int, int], thick: int) -> None:
        """Draw an open line through the points [px], `thick` pixels wide."""
        self._cv2.polylines(picture, [_fixed(points)], False, shade[::-1], thick, self._cv2.LINE_AA, _SHIFT)

    def lines(
        self, picture: np.ndarray, ends: Float[np.ndarray, "k 2 2"], shade: tuple[int, int, int], thick: int
    ) -> None:
        """Draw k straight lines between pairs of ends [px], `thick` pixels wide.

        Raises:
            InputError: ends has another shape.
        """
        self._cv2.polylines(picture, list(_fixed(ends)), False, shade[::-1], thick, self._cv2.LINE_AA, _SHIFT)

    def disc(self, picture: np.ndarray, at: np.ndarray, radius: float, shade: tuple[int, int, int]) -> None:
        """Draw a filled circle of this radius around a place [px]."""
        self.ring(picture, at, radius, shade, -1)

    def ring(self, picture: np.ndarray, at: np.ndarray, radius: float, shade: tuple[int, int, int], thick: int) -> None:
        """Draw a circle around a place [px] with a line `thick` pixels wide; -1 fills it."""
        x, y = _fixed(at).tolist()
        size = round(radius * (1 << _SHIFT))
        self._cv2.circle(picture, (x, y), size, shade[::-1], thick, self._cv2.LINE_AA, _SHIFT)

    def arrow(self, picture: np.ndarray, ends: Float[np.ndarray, "2 2"], shade: tuple[int, int, int]) -> None:
        """Draw an arrow from the first end to the second [px]; none below 1 px.

        Raises:
            InputError: ends has another shape.
        """
        way = ends[1] - ends[0]
        length = float(np.linalg.norm(way))
        if length < 1.0:
            return
        along = way / length
        across, head = np.array([-along[1], along[0]]), min(11.0, 0.7 * length)
        base = ends[1] - head * along
        self.line(picture, np.stack([ends[0], base]), shade, 3)
        self.area(picture, np.stack([ends[1], base + 0.5 * head * across, base - 0.5 * head * across]), shade)

    def text(
        self,
        picture: np.ndarray,
        words: str,
        at: tuple[int, int],
        size: float,
        shade: tuple[int, int, int],
        thick: int = 1,
    ) -> None:
        """Write text from its lower left corner [px]; characters outside ASCII become question marks."""
        known = words.encode("ascii", "replace").decode()
        self._cv2.putText(picture, known, at, self._font, size, shade[::-1], thick, self._cv2.LINE_AA)

    def middle(self, picture: np.ndarray, words: str, at: np.ndarray, size: float, shade: tuple[int, int, int]) -> None:
        """Write text centred at a place [px]."""
        (wide, high), _ = self._cv2.getTextSize(words, self._font, size, 1)
        self.text(picture, words, (round(at[0] - wide / 2), round(at[1] + high / 2)), size, shade)

    def width(self, words: str, size: float) -> int:
        """Return the width of a line of text [px]."""
        return int(self._cv2.getTextSize(words, self._font, size, 1)[0][0])

    def cut(self, words: str, size: float, room: int) -> str:
        """Return the text, shortened with ".." if it is wider than `room` [px]."""
        if self.width(words, size) <= room:
            return words
        while words and self.width(f"{words}..", size) > room:
            words = words[:-1]
        return f"{words}.."

    def shrunk(self, frame: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        """Return an image resized to (width, height) [px], (height, width, 3)."""
        return self._cv2.resize(frame, size, interpolation=self._cv2.INTER_AREA)


def _fixed(points: Float[np.ndarray, "*n 2"]) -> np.ndarray:
    """Convert places [px] to OpenCV's fixed-point integers."""
    return np.rint(points * (1 << _SHIFT)).astype(np.int32)
