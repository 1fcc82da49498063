"""One clock: where a page is in the drive, whether it plays, and how fast. One worker, latest value wins.

Callbacks of the page only change what is wanted; the worker alone shows frames, so nothing is ever queued:
a slow picture makes playback skip frames, not lag behind.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

SHORTEST_TICK_S = 1.0 / 20.0
"""Browsers slow down beyond about 24 picture updates a second; a tick sends one."""
IDLE_S = 0.25
AFTER_ERROR_S = 1.0
"""How long nothing is shown after an error in showing."""


@dataclass(frozen=True)
class ClockState:
    """What the viewer wants. `speed` 1 is the recording's own pace."""

    frame: int = 0
    playing: bool = False
    speed: float = 1.0
    loop: bool = False
    pause_on_failure: bool = False


class Playback:
    """Plays `total` frames at `timestamps_s`; `available()` frames can be played so far.

    `failures()` gives the failed frames known so far, ascending. `show(state)` is called from one worker
    thread whenever the state changed, and every IDLE_S otherwise. While playing, `choose(after, due)` may name a
    frame in after + 1 ... due that can be shown sooner than the one that is due.
    """

    def __init__(
        self,
        timestamps_s: NDArray[np.float64],
        available: Callable[[], int],
        failures: Callable[[], NDArray[np.int64]],
        show: Callable[[ClockState], None],
        choose: Callable[[int, int], int] = lambda _after, due: due,
    ) -> None:
        self._times = np.maximum.accumulate(np.nan_to_num(np.asarray(timestamps_s, dtype=np.float64)))
        self._available = available
        self._failures = failures
        self._show = show
        self._choose = choose
        self._state = ClockState()
        self._anchor = (0.0, 0.0)
        self._wake = threading.Condition()
        self._dirty = True
        self._closed = False
        self._thread: threading.Thread = threading.Thread(target=self._run, name="playback", daemon=True)

    @property
    def total(self) -> int:
        """Frames in the drive."""
        return len(self._times)

    @property
    def state(self) -> ClockState:
        """The present state (immutable)."""
        return self._state

    def start(self) -> None:
        """Start the worker."""
        self._thread.start()

    def close(self, timeout_s: float = 5.0) -> None:
        """Stop the worker and wait for it (unless called by it)."""
        with self._wake:
            self._closed = True
            self._wake.notify_all()
        if threading.current_thread() is not self._thread and self._thread.is_alive():
            self._thread.join(timeout=timeout_s)

    def poke(self) -> None:
        """Show the present frame again."""
        self._change()

    def seek(self, frame: int) -> None:
        """Go to a frame, clamped to the drive."""
        self._change(frame=int(np.clip(frame, 0, max(0, self.total - 1))))

    def step(self, count: int) -> None:
        """Move by `count` frames and pause."""
        frame = int(np.clip(self._state.frame + count, 0, max(0, self.total - 1)))
        self._change(frame=frame, playing=False)

    def toggle(self) -> None:
        """Play or pause; at the end, play from the start."""
        at_end = self._state.frame >= self.total - 1
        start_over = at_end and not self._state.playing
        self._change(playing=not self._state.playing, frame=0 if start_over else self._state.frame)

    def play(self, playing: bool = True) -> None:
        """Play or pause."""
        self._change(playing=playing)

    def set_speed(self, speed: float) -> None:
        """Speed as a multiple of the recording's pace."""
        self._change(speed=float(np.clip(speed, 0.05, 20.0)))

    def set_loop(self, loop: bool) -> None:
        """Start over at the end."""
        self._change(loop=loop)

    def set_pause_on_failure(self, pause: bool) -> None:
        """Stop at the next failed frame."""
        self._change(pause_on_failure=pause)

    def seek_failure(self, direction: int) -> int | None:
        """Go to the next (+1) or previous (-1) failed frame and pause, round the end of the drive where there is
        none left; None where no frame has failed."""
        failures, frame = self._failures(), self._state.frame
        if len(failures) == 0:
            return None
        beyond = failures[failures > frame] if direction > 0 else failures[failures < frame][::-1]
        target = int(beyond[0] if len(beyond) else failures[0 if direction > 0 else -1])
        self._change(frame=target, playing=False)
        return target

    def _change(self, **changes: float | bool | int) -> None:
        with self._wake:
            self._state = replace(self._state, **changes)  # type: ignore[arg-type]
            self._rebase()
            self._dirty = True
            self._wake.notify_all()

    def _rebase(self) -> None:
        time_s = float(self._times[self._state.frame]) if self.total else 0.0
        self._anchor = (time.monotonic(), time_s)

    def _advance(self) -> None:
        """Move a playing clock to the frame that is due. Called with the lock held."""
        state = self._state
        wall, media = self._anchor
        due = media + (time.monotonic() - wall) * state.speed
        frame = max(state.frame, int(np.searchsorted(self._times, due + 1e-9, side="right")) - 1)
        ready = self._available() - 1
        if state.frame < frame <= ready:
            frame = self._choose(state.frame, frame)
        playing = True
        if state.pause_on_failure:
            ahead = self._failures()
            ahead = ahead[(ahead > state.frame) & (ahead <= frame)]
            if len(ahead):
                frame, playing = int(ahead[0]), False
        if frame >= self.total - 1:
            frame = self.total - 1
            if state.frame == frame:
                frame, playing = (0, True) if state.loop else (frame, False)
        stalled = frame > ready
        if stalled:
            frame = max(state.frame, ready)
        if frame != state.frame or playing != state.playing:
            self._state = replace(state, frame=frame, playing=playing)
            self._dirty = True
        if stalled or (frame == 0 and state.frame != 0):
            self._rebase()

    def upcoming(self, ticks: int) -> list[int]:
        """The frames that will be due within the next ticks, nearest first; none while paused."""
        with self._wake:
            state, (wall, media) = self._state, self._anchor
        if not state.playing:
            return []
        ahead = media + (time.monotonic() - wall + SHORTEST_TICK_S * np.arange(1, ticks + 1)) * state.speed
        frames = np.searchsorted(self._times, ahead + 1e-9, side="right") - 1
        known = frames[(frames > state.frame) & (frames < self._available())]
        return [int(frame) for frame in np.unique(known)]

    def _pause_s(self, last: float) -> float:
        """How long nothing is due. Called with the lock held."""
        state, now = self._state, time.monotonic()
        if not state.playing:
            return IDLE_S
        wall, media = self._anchor
        following = min(state.frame + 1, self.total - 1)
        due = wall + (float(self._times[following]) - media) / state.speed
        return float(np.clip(due - now, SHORTEST_TICK_S - (now - last), IDLE_S))

    def _run(self) -> None:
        try:
            self._show_until_closed()
        finally:
            # Whatever it was is on the terminal; the page must not stand still for ever.
            if not self._closed:
                self._thread = threading.Timer(AFTER_ERROR_S, self._run)
                self._thread.daemon = True
                self._thread.start()

    def _show_until_closed(self) -> None:
        last = -1.0
        while True:
            with self._wake:
                if not self._dirty and not self._closed:
                    pause = self._pause_s(last)
                    if pause > 0:
                        self._wake.wait(pause)
                if self._closed:
                    return
                if self._state.playing and time.monotonic() - last >= SHORTEST_TICK_S:
                    self._advance()
                self._dirty = False
                state = self._state
            last = time.monotonic()
            self._show(state)
            with self._wake:
                # A change during show() is shown at once, but not faster than a browser can follow.
                if self._dirty and not self._closed:
                    rest = SHORTEST_TICK_S - (time.monotonic() - last)
                    if rest > 0:
                        self._wake.wait_for(lambda: self._closed, rest)
