"""A picture in a panel, encoded once for all browsers."""

from __future__ import annotations

from typing import Any

import numpy as np

from stereocalib_app.server.viser_internals import set_encoded

BLANK_GREY = 24


class PictureView:
    """An image element; blank until it is given something to show."""

    def __init__(self, gui: Any, width_px: int) -> None:
        self._image = gui.add_image(np.full((8, width_px, 3), BLANK_GREY, np.uint8), format="jpeg")
        self.jpeg = b""

    @property
    def visible(self) -> bool:
        """Whether it takes its place in the panel."""
        return bool(self._image.visible)

    @visible.setter
    def visible(self, wanted: bool) -> None:
        if self._image.visible != wanted:
            self._image.visible = wanted

    def show(self, jpeg: bytes) -> None:
        """Show encoded bytes."""
        self.jpeg = jpeg
        set_encoded(self._image, jpeg)
