"""docs/api.md and the newcomers of docs/extending.md, run as they stand."""

from __future__ import annotations

import importlib
import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from docs_page import DOCS, block, blocks

import stereocalib_core as sc
from stereocalib_core.sources import formats


def test_the_page_of_the_api_runs_from_top_to_bottom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    names: dict[str, object] = {}
    ran = 0
    for title, code in blocks("api.md"):
        if title != "boards":
            exec(compile(code, f"api.md, {code.splitlines()[0]}", "exec"), names)
            ran += 1
    assert ran >= 10
    page = (DOCS / "api.md").read_text(encoding="utf-8")
    functions = [name for name in sc.__all__ if name.islower() and name[0] != "_"]
    assert [name for name in functions if f"sc.{name}(" not in page] == []


def test_the_part_about_boards_runs(data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    boards = data_dir / "boards_vlp16"
    if not boards.is_dir():
        pytest.skip("no boards_vlp16")
    (tmp_path / "boards").symlink_to(boards)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"sc": sc}
    exec(block("api.md", "boards"), names)
    assert names["result"].T_camera_lidar.shape == (4, 4)  # type: ignore[attr-defined]


def test_another_matcher_by_hand_and_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "block_matching.py").write_text(block("extending.md", "block_matching.py"))
    monkeypatch.syspath_prepend(tmp_path)
    names: dict[str, object] = {}
    exec(block("extending.md", "by hand"), names)
    by_hand = [r.road for r in names["results"]]  # type: ignore[attr-defined]
    text = (DOCS / "extending.md").read_text(encoding="utf-8")
    (line,) = [line for line in text.splitlines() if "stereocalib run" in line and "--matcher" in line]
    path, program, *arguments = shlex.split(line)
    assert (path, program) == ("PYTHONPATH=.", "stereocalib")
    done = subprocess.run(
        [sys.executable, "-m", "stereocalib_app.cli.main", *arguments],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([".", *filter(None, sys.path)])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    drive = sc.load_run(tmp_path / "out")
    assert json.loads((tmp_path / "out" / "config.json").read_text())["disparity"]["matcher"] in line
    heights = [np.nan if road is None else road.extrinsics.height_m for road in by_hand]
    np.testing.assert_allclose(drive.frames.height_m, heights, atol=1e-6)
    ours = sc.calibrate("synthetic:straight?frames=6")
    assert not np.allclose(drive.frames.height_m, ours.frames.height_m, atol=1e-6, equal_nan=True)
    importlib.invalidate_caches()
    sys.modules.pop("block_matching", None)


def test_a_format_in_one_file_and_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = sc.open_source("synthetic:straight?frames=4")
    frames, camera = [source[i] for i in range(4)], source.camera
    numbers = camera.focal_px, camera.cx_px, camera.cy_px, camera.baseline_m
    left, right = (np.stack([getattr(f, side) for f in frames]) for side in ("left", "right"))
    np.savez(tmp_path / "stack.npz", left=left, right=right, times_s=source.timestamps_s, camera=numbers)
    with pytest.raises(sc.StereoCalibError):
        sc.open_source(str(tmp_path / "stack.npz"))
    newcomer: dict[str, object] = {"__name__": "picture_stack"}
    exec(block("extending.md", "stereocalib_core/sources/formats/picture_stack.py"), newcomer)
    monkeypatch.setattr(formats, "FORMATS", (newcomer["FORMAT"], *formats.FORMATS))
    drive, same = sc.calibrate(str(tmp_path / "stack.npz")), sc.calibrate(source)
    np.testing.assert_array_equal(drive.frames.values, same.frames.values)
    (tmp_path / "broken.npz").write_bytes((tmp_path / "stack.npz").read_bytes()[:100])
    with pytest.raises(sc.StereoCalibError, match="stack of pictures"):
        sc.open_source(str(tmp_path / "broken.npz"))
