"""The first moments of a page: pictures come first, the 3-D view when they move.

Without a graphics card a browser takes a second or more to begin a 3-D view, in which it draws nothing else. So a
page that a browser waits for sends its pictures alone until a second one has been drawn.
"""

from __future__ import annotations

import time
from collections.abc import Callable

STILL_S = 0.7
"""A page that stands still has drawn its first picture this long before it is taken for one that will not move."""
FIRST_FRAMES = 6
LONGEST_S = 6.0
"""Whatever browsers say, then it is over."""


class Debut:
    """Whether it is over, by what browsers say that they have drawn. Safe from any thread.

    over: nobody waits, nothing is put off. clock: seconds.
    """

    def __init__(self, over: bool, clock: Callable[[], float] = time.monotonic) -> None:
        self._over, self._clock, self._began = over, clock, clock()
        self._first: tuple[int, float] | None = None

    def drawn(self, frame: int) -> None:
        """A browser has drawn the picture of a frame."""
        if self._first is None:
            self._first = frame, self._clock()
        elif frame != self._first[0]:
            self._over = True

    def enough(self, frames: int) -> bool:
        """Whether so many computed frames are enough for now: a browser needs the processor too."""
        return frames >= FIRST_FRAMES and not self.over

    @property
    def over(self) -> bool:
        """Whether everything may come."""
        if not self._over:
            now = self._clock()
            still = self._first is not None and now - self._first[1] > STILL_S
            self._over = still or now - self._began > LONGEST_S
        return self._over
