"""Threads that are made once and kept: starting some for every frame would cost more than they save."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache

_LOCK = threading.Lock()
_inside, _before = 0, 1


def cores() -> int:
    """How many cores this process may use: a worker that is bound to one has one."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def bind_threads(to: set[int]) -> None:
    """Every thread of this process, and what they start from now on, to these cores, where the system can."""
    if not hasattr(os, "sched_setaffinity"):
        return
    for thread in os.listdir("/proc/self/task"):
        with suppress(OSError):  # it may have ended meanwhile
            os.sched_setaffinity(int(thread), to)


def shared_pool(name: str, threads: int) -> ThreadPoolExecutor:
    """The `threads` threads of that name; a forked process gets its own, since threads do not survive a fork."""
    return _pool(name, threads, os.getpid())


@cache
def _pool(name: str, threads: int, process: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix=name)


@contextmanager
def one_thread_each() -> Iterator[None]:
    """While several frames are worked on at once, OpenCV starts no threads within each: they would only wait for one
    another."""
    import cv2

    global _inside, _before
    with _LOCK:
        if _inside == 0:
            _before = cv2.getNumThreads()
            cv2.setNumThreads(1)
        _inside += 1
    try:
        yield
    finally:
        with _LOCK:
            _inside -= 1
            if _inside == 0:
                cv2.setNumThreads(_before)
