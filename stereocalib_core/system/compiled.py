"""The first command on a machine compiles what it needs: once, on every core, and not in silence.

numba compiles a loop when it is first called and keeps the machine code. Called one after the other, inside the
first frame, that is a minute on one core without a word. Here the rooms that a command needs are compiled by as
many processes as there are cores, before the command begins; what only the end of a drive needs, while its frames are
looked at. What is compiled is remembered by the content of the compiled sources: it costs some milliseconds ever after.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

from stereocalib_core.system.user_cache import user_cache

PACKAGE = Path(os.path.abspath(__file__)).parent.parent
SECONDS = {
    "sources": 1, "front.semi_global": 4, "front.rows": 4, "front.road": 14, "front.tracks": 10, "front.scan": 6,
    "front.own_car": 3, "back.rig": 12, "back.odometry": 13, "back.lidar": 3, "simulator": 10, "simulator.plane": 5,
    "boards": 3,
}  # fmt: skip
"""Every room with something to compile, and about how long it takes on one core: shares the work out evenly."""
FRONT = ("sources", "front.rows", "front.road", "front.tracks", "front.own_car")
"""What the first frame of a drive from a recording needs; the road compiles the matching that it begins with."""
SCANS = ("front.scan", "back.lidar")
"""What a drive with LiDAR scans needs besides."""
AFTER = ("back.rig", "back.odometry")
"""What only the end of a drive needs."""
DRIVE = FRONT + AFTER + SCANS
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
    """The rooms that were compiled already."""
    try:
        return set(marker.read_text(encoding="utf-8").split())
    except (OSError, UnicodeDecodeError):
        return set()


def in_place(room: str, package: Path = PACKAGE) -> bool:
    """Whether the room's machine code is still beside its sources, where numba keeps it: a package that was installed
    anew in the same place has none. Where numba keeps it elsewhere, it is not looked for."""
    if "NUMBA_CACHE_DIR" in os.environ or not os.access(package, os.W_OK):
        return True
    path = package.joinpath(*room.split("."))
    found = path.rglob("*.nbi") if path.is_dir() else path.parent.glob(f"__pycache__/{path.name}.*.nbi")
    return any(True for _ in found)


def missing(rooms: Sequence[str]) -> list[str]:
    """Those of `rooms` that are not compiled on this machine yet."""
    known = known_rooms(_marker())
    return [room for room in rooms if room not in known or not in_place(room)]


def known_also_in(cache: Path) -> None:
    """What is compiled is known in this empty folder for caches, too: what is measured with it is not compiling."""
    with contextlib.suppress(OSError):
        cache.mkdir(parents=True, exist_ok=True)
        shutil.copy(_marker(), cache)


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


class _Compiling:
    """Rooms that are being compiled, by as many processes as there are cores.

    behind: as an aside, while something else runs that must not be held up.
    """

    def __init__(self, rooms: Sequence[str], told: Callable[[int], None], behind: bool = False) -> None:
        self._rooms, self._told, self._behind = rooms, told, behind
        self._done: list[str] = []
        self._processes: list[subprocess.Popen[str]] = []
        hands = shares(rooms, os.cpu_count() or 1)
        self._threads = [threading.Thread(target=self._work, args=(hand,), daemon=behind) for hand in hands]
        for thread in self._threads:
            thread.start()

    def _work(self, hand: list[str]) -> None:
        command = [sys.executable, "-m", "stereocalib_core.system.warmup", *hand]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(PACKAGE.parent), *sys.path[1:]])}
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment
        ) as process:
            self._processes.append(process)
            if self._behind and hasattr(os, "setpriority"):
                with contextlib.suppress(OSError):
                    os.setpriority(os.PRIO_PROCESS, process.pid, 10)
            assert process.stdout is not None
            for line in process.stdout:
                self._done.append(line.strip())
                self._told(len(self._done))

    def finish(self) -> None:
        """Wait, and remember what was compiled; a room that failed is compiled when it is first used."""
        for thread in self._threads:
            thread.join()
        remember([room for room in self._done if room in self._rooms])

    def stop(self) -> None:
        """Nobody needs the rest any more."""
        for process in self._processes:
            process.terminate()


_behind: list[_Compiling] = []


def compile_once(
    rooms: Sequence[str],
    say: Callable[[str], None],
    progress: Progress | None = None,
    later: Sequence[str] = (),
) -> None:
    """Compile those of `rooms` that are not compiled on this machine yet; says so before it begins.

    later: rooms that are compiled from then on while the command goes on; `await_compiled` waits for them.
    """
    now = missing(rooms)
    if now:
        seconds = max(sum(SECONDS[room] for room in hand) for hand in shares(now, os.cpu_count() or 1))
        also = "; what only the end of a drive needs, meanwhile" if later else ""
        say(f"compiling once for this machine, about {seconds + 3} s{also}")

        def told(done: int) -> None:
            if progress:
                progress(done, len(now), "compiling once for this machine")

        _Compiling(now, told).finish()
    rest = missing(later)
    if rest:
        compiling = _Compiling(rest, lambda done: None, behind=True)
        _behind.append(compiling)
        atexit.register(compiling.stop)


def await_compiled(waiting: Callable[[], None] | None = None) -> None:
    """Wait until what `compile_once` left for later is compiled: who needs it now would only compile it once more.

    waiting: called before, where there is something to wait for.
    """
    if _behind and waiting:
        waiting()
    while _behind:
        compiling = _behind.pop()
        compiling.finish()
        atexit.unregister(compiling.stop)
