"""Compiled code of an installation that cannot be written.

numba keeps what it compiles beside the sources, and looks there only where it may also write. So an installation
that belongs to somebody else would be compiled again by every user. For such a one this makes a folder of links
to what was compiled with the installation, and tells numba to read and write there.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import tempfile
from pathlib import Path

from stereocalib_core.system.user_cache import user_cache

PACKAGE = Path(os.path.abspath(__file__)).parent.parent
VARIABLE = "NUMBA_CACHE_DIR"


def use_installed_code(package: Path = PACKAGE) -> Path | None:
    """Set NUMBA_CACHE_DIR where the installation cannot be written; the folder, or None where nothing was done.

    To be called before numba is imported. A NUMBA_CACHE_DIR that is set already is left alone.
    """
    if os.environ.get(VARIABLE):
        return None
    indices = sorted(package.rglob("__pycache__/*.nbi"))
    if not indices or all(os.access(folder, os.W_OK) for folder in {path.parent for path in indices}):
        return None
    states = [(str(path), status.st_size, status.st_mtime_ns) for path in indices if (status := path.stat())]
    name = f"compiled-{hashlib.sha256(repr(states).encode()).hexdigest()[:16]}"
    folder = _linked(user_cache() / name, indices)
    if folder is None:
        # a user without a home: for this process only
        own = tempfile.mkdtemp(prefix="stereocalib-")
        atexit.register(shutil.rmtree, own, ignore_errors=True)
        folder = _linked(Path(own) / name, indices)
    if folder is not None:
        os.environ[VARIABLE] = str(folder)
    return folder


def _linked(target: Path, indices: list[Path]) -> Path | None:
    """`target` with links to the compiled code of these indices, None where it cannot be made."""
    if target.is_dir() and os.access(target, os.W_OK):
        return target
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        growing = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
        for cache in sorted({path.parent for path in indices}):
            place = growing / _numba_folder(cache.parent)
            place.mkdir()
            for path in cache.glob("*.nb[ic]"):
                _link(path, place / path.name)
        os.rename(growing, target)
    except FileExistsError:
        return target
    except OSError:
        return target if target.is_dir() and os.access(target, os.W_OK) else None
    return target


def _numba_folder(sources: Path) -> str:
    """The folder that numba uses below NUMBA_CACHE_DIR for the modules of a folder."""
    return f"{sources.name}_{hashlib.sha1(str(sources).encode()).hexdigest()}"


def _link(path: Path, place: Path) -> None:
    try:
        place.symlink_to(path)
    except OSError:
        shutil.copy2(path, place)
