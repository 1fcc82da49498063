"""Threads that are made once and kept: starting some for every frame would cost more than they save."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache


def shared_pool(name: str, threads: int) -> ThreadPoolExecutor:
    """The `threads` threads of that name; a forked process gets its own, since threads do not survive a fork."""
    return _pool(name, threads, os.getpid())


@cache
def _pool(name: str, threads: int, process: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix=name)
