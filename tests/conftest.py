"""Shared fixtures: where the real recordings are, and what to do without them."""

from __future__ import annotations

import os
import shutil
import signal
from pathlib import Path

import pytest

from stereocalib_core.system.compiled import SECONDS, compile_once

REPO = Path(__file__).resolve().parents[1]
BROWSER_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")


# A shell that starts the tests in the background ignores Ctrl-C, and so would every program that they start.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_sessionstart(session: pytest.Session) -> None:
    """After an edit of a compiled loop: compiled here, so that no command says so in the middle of a test."""
    if not hasattr(session.config, "workerinput"):
        compile_once(list(SECONDS), print)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What waits for a browser, another process or a clock may be out of luck on a machine that others use, and is
    tried twice more, which the summary lists as RERUN; what fails every time is a defect."""
    for item in items:
        if item.get_closest_marker("wall_clock") or item.path.is_relative_to(REPO / "tests" / "app"):
            item.add_marker(pytest.mark.flaky(reruns=2))


def _skip_or_fail(reason: str, requirement: str) -> None:
    if os.environ.get(requirement) == "1":
        pytest.fail(f"{requirement}=1 but {reason}")
    pytest.skip(reason)


def _recordings() -> Path:
    return Path(os.environ.get("STEREOCALIB_DATA", REPO.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real recordings; skips (or fails under STEREOCALIB_REQUIRE_DATA=1) without it."""
    folder = _recordings()
    if not folder.is_dir():
        _skip_or_fail(f"no recordings at {folder}: set STEREOCALIB_DATA", "STEREOCALIB_REQUIRE_DATA")
    return folder


@pytest.fixture(scope="session")
def kitti_06(data_dir: Path) -> Path:
    return data_dir / "kitti_odometry" / "sequences" / "06"


@pytest.fixture(scope="session")
def kitti_03(data_dir: Path) -> Path:
    return data_dir / "kitti_odometry" / "sequences" / "03"


@pytest.fixture(scope="session")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A street of 40 frames or more: KITTI 03 where it is at hand, else a rendered one in the same layout."""
    recorded = _recordings() / "kitti_odometry" / "sequences" / "03"
    if recorded.is_dir():
        return recorded
    from stereocalib_core.run.synth import synth

    out = tmp_path_factory.mktemp("street")
    synth(out, "town", {"frames": "40"}, [])
    return out / "sequences" / "00"


@pytest.fixture(scope="session")
def short_drive(street: Path) -> Path:
    """KITTI 06 where it is at hand, else the rendered street: whatever its pictures show."""
    recorded = _recordings() / "kitti_odometry" / "sequences" / "06"
    return recorded if recorded.is_dir() else street


@pytest.fixture(scope="session")
def kitti_raw_0009(data_dir: Path) -> Path:
    return data_dir / "kitti_raw" / "2011_09_26" / "2011_09_26_drive_0009_sync"


@pytest.fixture(scope="session")
def chromium_path() -> str:
    """A Chromium or Chrome on this machine; skips (or fails under STEREOCALIB_REQUIRE_BROWSER=1) without one."""
    override = os.environ.get("STEREOCALIB_CHROMIUM")
    path = override or next((found for name in BROWSER_NAMES if (found := shutil.which(name))), None)
    if path is None:
        _skip_or_fail(
            "no Chromium or Chrome found: install one (Debian: apt-get install chromium) or set STEREOCALIB_CHROMIUM",
            "STEREOCALIB_REQUIRE_BROWSER",
        )
    return str(path)


@pytest.fixture(scope="session")
def kitti_raw_0005(data_dir: Path) -> Path:
    return data_dir / "kitti_raw" / "2011_09_26" / "2011_09_26_drive_0005_sync"


@pytest.fixture(scope="session")
def karlsruhe(data_dir: Path) -> Path:
    return data_dir / "karlsruhe"
