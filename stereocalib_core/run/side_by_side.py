"""Neighbouring frames on every core at once: what a pair shows by itself is made ahead, what needs the pair before
is made in order. The results are the same bits as those of one frame after another."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from typing import TYPE_CHECKING

from stereocalib_core.errors import StereoCalibError
from stereocalib_core.frames import FrameSource, StereoFrame
from stereocalib_core.geometry import Extrinsics
from stereocalib_core.numeric.threads import cores, one_thread_each
from stereocalib_core.sources import prefetch

if TYPE_CHECKING:
    from stereocalib_core.front.pipeline import FrontEnd, Look, Prepared


def looks(
    front_end: FrontEnd, source: FrameSource, start: int, stop: int
) -> Iterator[tuple[StereoFrame, Look]]:
    """Frames start...stop - 1 in order, each with what the front end sees in it.

    Of a live source no frame is begun before it is asked for, and on one core none is prepared ahead.
    """
    with closing(prefetch(source, start, stop)) as frames:
        if source.live or cores() == 1:
            for frame in frames:
                yield frame, front_end.look(frame)
            return
        yield from _ahead(front_end, frames)


def _ahead(front_end: FrontEnd, frames: Iterator[StereoFrame]) -> Iterator[tuple[StereoFrame, Look]]:
    """As many frames are being prepared as the front end has roads to prepare them with."""
    waiting: deque[Future[tuple[StereoFrame, Prepared | None]]] = deque()
    pool = ThreadPoolExecutor(len(front_end.pasts) - 1, thread_name_prefix="prepare")

    def begin(past: Extrinsics | None) -> None:
        try:
            frame = next(frames)
        except StopIteration:
            return
        except StereoCalibError as error:  # of a frame whose turn has not come
            waiting.append(Future())
            waiting[-1].set_exception(error)
            return
        waiting.append(pool.submit(lambda: (frame, front_end.prepare(frame, past))))

    with one_thread_each():
        try:
            for past in front_end.pasts:
                begin(past)
            while waiting:
                frame, prepared = waiting.popleft().result()
                look = front_end.look(frame, prepared)
                begin(front_end.pasts[-1])
                yield frame, look
        finally:
            # what is being prepared reads pictures that whoever closes this may take away
            pool.shutdown(wait=True, cancel_futures=True)
