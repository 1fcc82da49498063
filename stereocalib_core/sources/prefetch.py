"""Reading ahead: the next frames are decoded while the present one is worked on."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor

from stereocalib_core.frames import FrameSource, StereoFrame


def prefetch(
    source: FrameSource, start: int, stop: int, ahead: int = 4
) -> Generator[StereoFrame, None, None]:
    """Frames start...stop - 1 in order, at most `ahead` of them read in advance by one worker thread.

    Closing the iterator early waits for the frame being read and no other. A live source is not read ahead,
    and ends the iteration when it has no more.
    """
    if source.live:
        yield from _as_they_come(source, start, stop)
        return
    pool = ThreadPoolExecutor(1, thread_name_prefix="prefetch")
    waiting: deque[Future[StereoFrame]] = deque()
    following = iter(range(start, stop))
    try:
        for index in following:
            waiting.append(pool.submit(source.__getitem__, index))
            if len(waiting) >= ahead:
                break
        while waiting:
            frame = waiting.popleft().result()
            index_or_none = next(following, None)
            if index_or_none is not None:
                waiting.append(pool.submit(source.__getitem__, index_or_none))
            yield frame
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _as_they_come(source: FrameSource, start: int, stop: int) -> Iterator[StereoFrame]:
    for index in range(start, stop):
        try:
            frame = source[index]
        except IndexError:
            return
        yield frame
