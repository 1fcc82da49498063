"""An installation that its user cannot write: what was compiled with it is used, and nothing is compiled again."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from pathlib import Path

import pytest

from stereocalib_core.system.installed_code import use_installed_code

COMPILED = """
import numpy as np
from numba import njit
@njit(cache=True)
def twice(x):
    return 2.0 * x
"""
ASK = """
import sys
sys.path.insert(0, {root!r})
from stereocalib_core.system.installed_code import use_installed_code
use_installed_code(__import__("pathlib").Path({root!r}))
import compiled_here
assert compiled_here.twice(3.0) == 6.0
stats = compiled_here.twice.stats
print(sum(stats.cache_hits.values()), sum(stats.cache_misses.values()))
"""


def give_up_override() -> None:
    """Root without the right to write what is write-protected (PR_CAPBSET_DROP of CAP_DAC_OVERRIDE)."""
    if ctypes.CDLL(None, use_errno=True).prctl(24, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl")


def ask(root: Path, home: Path) -> list[int]:
    """Cache hits and misses of a process that calls the compiled function and cannot write the protected."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(home / ".cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    for name in ("NUMBA_CACHE_DIR", "STEREOCALIB_CACHE"):
        environment.pop(name, None)
    done = subprocess.run(
        [sys.executable, "-c", ASK.format(root=str(root))],
        env=environment, capture_output=True, text=True, check=False,
        preexec_fn=give_up_override if os.geteuid() == 0 else None,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return [int(word) for word in done.stdout.split()]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="write protection is tested on Linux only")
@pytest.mark.parametrize("with_home", [True, False])
def test_what_was_compiled_at_the_installation_is_used(tmp_path: Path, with_home: bool) -> None:
    root, home = tmp_path / "package", tmp_path / "home"
    root.mkdir()
    home.mkdir()
    (root / "compiled_here.py").write_text(COMPILED)
    try:
        assert ask(root, home) == [0, 1]
    except subprocess.SubprocessError:
        pytest.skip("this root keeps the right to write everything")
    protected = [root / "__pycache__", root, *([] if with_home else [home])]
    for folder in protected:
        folder.chmod(0o555)
    try:
        assert ask(root, home) == [1, 0]
    finally:
        for folder in protected:
            folder.chmod(0o755)
    assert bool(list(home.rglob("*.nbi"))) == with_home


def test_a_folder_that_can_be_written_is_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "__pycache__" / "a.f-1.py311.nbi").write_bytes(b"")
    assert use_installed_code(tmp_path) is None
    assert "NUMBA_CACHE_DIR" not in os.environ


def test_filterpy_comes_without_scipy_stats_and_whole_for_whoever_asks() -> None:
    """In a process of its own: this one has imported everything."""
    code = """
import sys
import numpy as np
from stereocalib_core.back.rig import body_filter
assert "scipy.stats" not in sys.modules
from filterpy.kalman.UKF import logpdf
assert abs(logpdf(np.zeros(2), np.zeros(2), np.eye(2)) + np.log(2.0 * np.pi)) < 1e-9
import filterpy.stats
assert filterpy.stats.__file__ and filterpy.stats.gaussian(0.0, 0.0, 1.0) > 0.3
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
