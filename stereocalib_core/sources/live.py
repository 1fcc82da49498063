"""A live camera: always the newest picture, never a queue."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config.reading import LIVE_TIMEOUT_S


class LiveReader:
    """Reads a device without pause in a thread of its own and keeps only the newest picture.

    Whoever is slower than the device gets fewer pictures, not older ones.
    """

    def __init__(self, read: Callable[[], tuple[bool, Any]]) -> None:
        """`read` waits for the next picture and gives (True, picture), or (False, anything) at the end."""
        self._read = read
        self._news = threading.Condition()
        self._picture: NDArray[np.uint8] | None = None
        self._time_s = 0.0
        self._ended = False
        self.started_ns = time.time_ns()
        self.dropped = 0
        self._began = time.monotonic()
        threading.Thread(target=self._pump, name="live-camera", daemon=True).start()

    def _pump(self) -> None:
        while True:
            ok, picture = self._read()
            with self._news:
                self._ended = not ok
                if ok:
                    self.dropped += self._picture is not None
                    self._picture = np.asarray(picture, dtype=np.uint8)
                    self._time_s = time.monotonic() - self._began
                self._news.notify_all()
            if not ok:
                return

    def newest(self) -> tuple[float, NDArray[np.uint8]]:
        """Seconds since the start and the newest picture not yet given; waits for one.

        Raises IndexError when the device has ended or gives nothing for five seconds.
        """
        with self._news:
            self._news.wait_for(lambda: self._picture is not None or self._ended, LIVE_TIMEOUT_S)
            if self._picture is None:
                raise IndexError("the live camera has ended")
            picture, self._picture = self._picture, None
            return self._time_s, picture
