"""The clock: what is wanted is shown, the latest value wins, failures stop it."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from conftest import until
from stereocalib_app.server.clock import ClockState, Playback


class Screen:
    """Records what is shown; `slow_s` imitates a slow picture."""

    def __init__(self) -> None:
        self.frames: list[int] = []
        self.threads: set[int] = set()
        self.slow_s = 0.0

    def show(self, state: ClockState) -> None:
        self.threads.add(threading.get_ident())
        time.sleep(self.slow_s)
        self.frames.append(state.frame)


@pytest.fixture
def clock() -> Iterator[tuple[Playback, Screen, dict[str, Any]]]:
    known: dict[str, Any] = {"ready": 40, "failed": [12, 13, 30]}
    screen = Screen()
    playback = Playback(
        np.arange(40) * 0.1,
        lambda: known["ready"],
        lambda: np.array(known["failed"], dtype=np.int64),
        screen.show,
    )
    playback.start()
    yield playback, screen, known
    playback.close()


def test_seeking_shows_the_last_wanted_frame_and_skips_the_rest(clock: Any) -> None:
    playback, screen, _ = clock
    screen.slow_s = 0.05
    for frame in range(40):
        playback.seek(frame)
    until(lambda: screen.frames and screen.frames[-1] == 39)
    assert len(screen.frames) < 12
    assert len(screen.threads) == 1


def test_plays_at_the_pace_of_the_recording(clock: Any) -> None:
    playback, screen, _ = clock
    begin = time.monotonic()
    playback.play()
    until(lambda: playback.state.frame >= 10)
    elapsed = time.monotonic() - begin
    assert 0.9 <= elapsed < 2.5
    assert screen.frames == sorted(screen.frames)


def test_a_slow_picture_skips_frames_instead_of_lagging(clock: Any) -> None:
    playback, screen, _ = clock
    screen.slow_s = 0.35
    playback.set_speed(2.0)
    begin = time.monotonic()
    playback.play()
    until(lambda: playback.state.frame >= 39)
    assert time.monotonic() - begin < 4.0
    assert len(screen.frames) < 15


def test_waits_for_frames_that_are_not_computed(clock: Any) -> None:
    playback, _, known = clock
    known["ready"] = 5
    playback.set_speed(8.0)
    playback.play()
    until(lambda: playback.state.frame == 4)
    time.sleep(0.3)
    assert playback.state.frame == 4
    assert playback.state.playing
    known["ready"] = 40
    until(lambda: playback.state.frame > 6)
    assert playback.state.frame < 39


def test_pauses_on_the_first_failure_even_when_frames_are_skipped(clock: Any) -> None:
    playback, screen, _ = clock
    screen.slow_s = 0.3
    playback.set_speed(4.0)
    playback.set_pause_on_failure(True)
    playback.play()
    until(lambda: not playback.state.playing)
    assert playback.state.frame == 12
    until(lambda: screen.frames[-1] == 12)


def test_next_and_previous_failure(clock: Any) -> None:
    playback, _, _ = clock
    assert playback.seek_failure(1) == 12
    assert playback.seek_failure(1) == 13
    assert playback.seek_failure(1) == 30
    assert playback.seek_failure(1) == 12  # round the end
    assert playback.seek_failure(-1) == 30
    assert playback.seek_failure(-1) == 13
    playback._failures = lambda: np.zeros(0, np.int64)
    assert playback.seek_failure(1) is None
    assert playback.state.frame == 13


def test_loops_only_when_asked(clock: Any) -> None:
    playback, _, _ = clock
    playback.seek(37)
    playback.play()
    until(lambda: not playback.state.playing)
    assert playback.state.frame == 39
    playback.set_loop(True)
    playback.play()
    until(lambda: playback.state.frame < 5)
    assert playback.state.playing


def test_play_at_the_end_starts_over(clock: Any) -> None:
    playback, _, _ = clock
    playback.seek(39)
    playback.toggle()
    until(lambda: 0 < playback.state.frame < 10)


def test_while_playing_a_frame_that_is_ready_is_preferred() -> None:
    shown: list[int] = []
    playback = Playback(
        np.arange(60) * 0.05,
        lambda: 60,
        lambda: np.zeros(0, dtype=np.int64),
        lambda state: shown.append(state.frame),
        lambda after, due: due if due % 2 == 0 or due - 1 <= after else due - 1,
    )
    playback.start()
    playback.set_speed(2.0)
    playback.play()
    time.sleep(0.8)
    playback.close()
    assert len(shown) > 5
    assert shown == sorted(shown)
    assert sum(frame % 2 == 0 for frame in shown) > 0.7 * len(shown)
