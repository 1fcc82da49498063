"""The first command on a machine compiles what it needs: once, on every core, and not in silence.

numba compiles a loop when it is first called and keeps the machine code. Called one after the other, inside the
first frame, that is a minute on one core without a word. Here the rooms that a command needs are compiled by as
many processes as there are cores, before the command begins. What is compiled is remembered by the content of the
compiled sources, so that it costs some milliseconds ever after.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

from stereocalib_core.system.user_cache import user_cache

PACKAGE = Path(os.path.abspath(__file__)).parent.parent
SECONDS = {
    "sources": 2, "front.semi_global": 4, "front.rows": 5, "front.road": 14, "front.tracks": 12, "front.scan": 2,
    "back.rig": 5, "back.odometry": 15, "back.lidar": 2, "simulator": 12, "boards": 3,
}  # fmt: skip
"""Every room with something to compile, and about how long it takes on one core: shares the work out evenly."""
DRIVE = (
    "sources",
    "front.semi_global",
    "front.rows",
    "front.road",
    "front.tracks",
    "front.scan",
    "back.rig",
    "back.odometry",
    "back.lidar",
)
"""What a drive from a recording needs."""
Progress = Callable[[int, int, str], None]


def fingerprint() -> str:
    """Of everything that the compiled code depends on: the sources that are compiled, numba and the processor."""
    digest = hashlib.sha256(f"{version('numba')} {sys.version} {platform.machine()} {PACKAGE}".encode())
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_bytes()
        if b"njit" in text or b"intrinsic" in text:
            digest.update(text)
    return digest.hexdigest()[:20]


def _marker() -> Path:
    return user_cache() / f"compiled-rooms-{fingerprint()}"


def known_rooms(marker: Path) -> set[str]:
    """The rooms that are compiled already."""
    try:
        return set(marker.read_text(encoding="utf-8").split())
    except (OSError, UnicodeDecodeError):
        return set()


def remember(rooms: Sequence[str]) -> None:
    """These rooms are compiled. A user without a home for caches is told again next time."""
    marker = _marker()
    with contextlib.suppress(OSError):
        marker.parent.mkdir(parents=True, exist_ok=True)
        growing = marker.with_name(f".{marker.name}-{os.getpid()}")
        growing.write_text("\n".join(sorted(known_rooms(marker) | set(rooms))), encoding="utf-8")
        growing.replace(marker)


def shares(rooms: Sequence[str], workers: int) -> list[list[str]]:
    """The rooms dealt out to so many workers, the longest first, each to whoever has least to do."""
    hands: list[list[str]] = [[] for _ in range(max(1, min(workers, len(rooms))))]
    for room in sorted(rooms, key=lambda r: -SECONDS[r]):
        min(hands, key=lambda hand: sum(SECONDS[r] for r in hand)).append(room)
    return hands


def compile_once(rooms: Sequence[str], say: Callable[[str], None], progress: Progress | None = None) -> None:
    """Compile those of `rooms` that are not compiled on this machine yet; says so before it begins."""
    missing = [room for room in rooms if room not in known_rooms(_marker())]
    if not missing:
        return
    hands = shares(missing, os.cpu_count() or 1)
    seconds = max(sum(SECONDS[room] for room in hand) for hand in hands)
    say(f"compiling once for this machine, about {seconds + 3} s")
    done: list[str] = []

    def work(hand: list[str]) -> None:
        command = [sys.executable, "-m", "stereocalib_core.system.warmup", *hand]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(PACKAGE.parent), *sys.path[1:]])}
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment
        ) as process:
            assert process.stdout is not None
            for line in process.stdout:
                done.append(line.strip())
                if progress:
                    progress(len(done), len(missing), "compiling once for this machine")

    threads = [threading.Thread(target=work, args=(hand,)) for hand in hands]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    # a room that failed here is compiled when it is first used
    remember([room for room in done if room in rooms])
