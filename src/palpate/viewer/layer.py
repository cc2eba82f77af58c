"""What a sensor adds to the page: things in the scene, lines of the caption, controls and pictures in the panel."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from viser import ClientHandle, GuiApi, ViserServer

    from palpate.viewer.scene import Scene

__all__ = ["Layer"]


@runtime_checkable
class Layer(Protocol):
    """Drawn once, and then moved from moment to moment."""

    @property
    def covers(self) -> bool:
        """It hides the body below it, and its heat."""
        ...

    @property
    def places(self) -> Float[np.ndarray, "k 3"]:
        """[m] what the picture must hold where the body has no mesh."""
        ...

    def draw(self, server: ViserServer | ClientHandle, scene: Scene) -> None:
        """Add what stands in the scene, in `Scene.placed` units."""
        ...

    def panel(self, gui: GuiApi) -> None:
        """Add controls and pictures below the caption."""
        ...

    def show(self, scene: Scene, index: int) -> None:
        """Move everything to a sample of the scene, or of one with other contacts on the same body."""
        ...

    def rows(self, scene: Scene, index: int) -> list[tuple[str, str]]:
        """Names and values with their units, plain text, below those of the contacts."""
        ...

    def legend(self) -> list[str]:
        """What its marks and colours are, as `palpate.viewer.legend` makes it."""
        ...
