"""Neighbouring frames on every core at once: what a pair shows by itself is made ahead, what needs the pair before
is made in order. The results are the same bits as those of one frame after another."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import closing
from typing import TYPE_CHECKING

from stereocalib_core.config.running import READ_AHEAD
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
    if not source.live and cores() > 1:
        yield from _ahead(front_end, source, start, stop)
        return
    with closing(prefetch(source, start, stop)) as frames:
        for frame in frames:
            yield frame, _look(front_end, frame)


def _look(
    front_end: FrontEnd, frame: StereoFrame, seen: Prepared | None = None, aside: Executor | None = None
) -> Look:
    """`front_end.look`; a Ctrl-C in the moment in which a compiled loop hands over its result stays a Ctrl-C."""
    try:
        return front_end.look(frame, seen, aside)
    except SystemError as error:
        cause: BaseException | None = error
        while isinstance(cause, SystemError):
            cause = cause.__cause__
        if isinstance(cause, KeyboardInterrupt):
            raise KeyboardInterrupt from None
        raise


def _ahead(
    front_end: FrontEnd, source: FrameSource, start: int, stop: int
) -> Iterator[tuple[StereoFrame, Look]]:
    """One thread reads, in order; as many frames are prepared as the front end has roads to prepare them with.

    What goes wrong with a frame is raised when its turn comes.
    """
    coming = iter(range(start, stop))
    read: deque[Future[StereoFrame]] = deque()
    waiting: deque[Future[tuple[StereoFrame, Prepared | None]]] = deque()
    reader = ThreadPoolExecutor(1, thread_name_prefix="prefetch")
    pool = ThreadPoolExecutor(len(front_end.pasts) - 1, thread_name_prefix="prepare")
    aside = ThreadPoolExecutor(1, thread_name_prefix="aside")

    def read_on() -> None:
        if (index := next(coming, None)) is not None:
            read.append(reader.submit(source.__getitem__, index))

    def prepared(frame: Future[StereoFrame], past: Extrinsics | None) -> tuple[StereoFrame, Prepared | None]:
        return frame.result(), front_end.prepare(frame.result(), past)

    def begin(past: Extrinsics | None) -> None:
        if read:
            waiting.append(pool.submit(prepared, read.popleft(), past))
            read_on()

    with one_thread_each():
        try:
            for _ in range(READ_AHEAD):
                read_on()
            for past in front_end.pasts:
                begin(past)
            while waiting:
                frame, seen = waiting.popleft().result()
                look = _look(front_end, frame, seen, aside)
                begin(front_end.pasts[-1])
                yield frame, look
        finally:
            aside.shutdown(wait=False)
            reader.shutdown(wait=False, cancel_futures=True)
            # what is being prepared reads pictures that whoever closes this may take away
            pool.shutdown(wait=True, cancel_futures=True)
