"""The face for scripts: the same results as `run`, each pair matched once, and any matcher in the place of ours."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from stereocalib_app.cli.main import main
from stereocalib_app.drive.frame_views import Look
from stereocalib_app.drive.session import Session

import stereocalib_core as sc
from stereocalib_core.config import DisparityConfig
from stereocalib_core.front import matching
from stereocalib_core.run.drive import run_drive

DRIVE = "synthetic:plane?frames=8&width=320&height=120&focal_px=185&cx_px=157&cy_px=55"


class Counting:
    """Our matcher, counting its calls; what it gives is shifted by `by` pixels."""

    def __init__(self, by: float = 0.0) -> None:
        self.steps: list[int] = []
        self.by = np.float32(by)

    @property
    def calls(self) -> int:
        return len(self.steps)

    @property
    def fine(self) -> int:
        """Without the coarse maps of what lies above the horizon."""
        return self.steps.count(min(self.steps))

    def __call__(self, *pair: object, **more: object) -> sc.DisparityMap:
        found = matching.compute(*pair, **more)  # type: ignore[arg-type]
        self.steps.append(found.step_px)
        return sc.DisparityMap(found.values + self.by, found.step_px)


@pytest.fixture
def counting(monkeypatch: pytest.MonkeyPatch) -> Counting:
    counting = Counting()
    monkeypatch.setitem(matching.MATCHERS, "sgbm", counting)
    return counting


def test_a_script_gives_what_run_gives(tmp_path: Path) -> None:
    seen: list[tuple[int, int, str]] = []
    drive = sc.calibrate(DRIVE, progress=lambda *done: seen.append(done))
    assert seen[-1] == (8, 8, "frames")
    (tmp_path / "script").mkdir()
    sc.write_run(drive, tmp_path / "script")
    run_drive(DRIVE, tmp_path / "run")
    for name in ("extrinsics.csv", "trajectory.txt", "trajectory.tum", "rig.yaml", "config.json"):
        assert (tmp_path / "script" / name).read_bytes() == (tmp_path / "run" / name).read_bytes(), name
    reports = [json.loads((tmp_path / kind / "report.json").read_text()) for kind in ("script", "run")]
    for report in reports:
        del report["timing_ms"], report["frames_per_second"]
    assert reports[0] == reports[1]


def test_a_range_of_frames_of_an_open_source() -> None:
    drive = sc.calibrate(sc.open_source(DRIVE), frames=(3, 6))
    assert drive.frames.frame.tolist() == [3, 4, 5]
    with pytest.raises(sc.StereoCalibError, match="outside the drive"):
        sc.calibrate(DRIVE, frames=(8, None))


def test_a_run_matches_each_pair_once_also_when_it_is_recorded(tmp_path: Path, counting: Counting) -> None:
    run_drive(DRIVE, tmp_path / "run", rrd=True)
    assert counting.fine == 8 and counting.calls <= 16


def test_a_page_matches_each_pair_once(counting: Counting) -> None:
    session = Session(sc.open_source(DRIVE), sc.PipelineConfig())
    session.views.get(0, Look("v-disparity"))  # the first picture is asked for before the front end has begun
    session.start()
    assert session.wait(60.0)
    for frame in range(8):
        assert session.views.get(frame, Look("v-disparity")).jpeg
    session.close()
    assert counting.fine == 8 and counting.calls <= 16


def test_a_frame_that_is_shown_alone_is_seen_as_the_drive_saw_it() -> None:
    source, config = sc.open_source("synthetic:curves?frames=8"), sc.PipelineConfig()
    front_end, done = sc.FrontEnd(source.camera, config), []
    for i in range(8):
        done.append((front_end.step(source[i]), front_end.memory))
    alone = sc.FrontEnd(source.camera, config)
    shown = alone.stages(source[7], done[:7])
    assert shown is not None and shown.estimate is not None and done[7][0].road is not None
    assert shown.estimate.extrinsics == done[7][0].road.extrinsics
    by_itself = alone.stages(source[7])
    assert by_itself is not None and by_itself.estimate is not None
    assert by_itself.estimate.extrinsics != shown.estimate.extrinsics
    smaller = source.camera.shrunk(2)
    single = dataclasses.replace(
        source[7],
        camera=smaller,
        left=matching.shrunk(source[7].left, 2),
        right=matching.shrunk(source[7].right, 2),
    )
    own = alone.stages(single, done[:7])
    assert own is not None and own.estimate is not None
    assert own.estimate.extrinsics.height_m == pytest.approx(shown.estimate.extrinsics.height_m, abs=0.03)


def test_what_is_matched_once_is_what_the_matcher_gives() -> None:
    source, counting = sc.open_source(DRIVE), Counting()
    once = matching.MatchedOnce(counting, maps=2)
    pairs = [(frame.left, frame.right) for frame in (source[i] for i in range(3))]
    config = DisparityConfig()
    maps = [once(left, right, source.camera, config) for left, right in pairs]  # type: ignore[arg-type]
    for (left, right), found in zip(pairs, maps, strict=True):
        expected = matching.compute(left, right, source.camera, config)  # type: ignore[arg-type]
        np.testing.assert_array_equal(found.values, expected.values)
    assert once(*pairs[2], source.camera, config) is maps[2] and counting.calls == 3  # type: ignore[arg-type]
    assert once(*pairs[2], source.camera, DisparityConfig(scale=1)).step_px == 1  # type: ignore[arg-type]
    once(*pairs[0], source.camera, config)  # type: ignore[arg-type]  # forgotten by now
    assert counting.calls == 5


def test_another_matcher_is_what_the_front_end_sees() -> None:
    """One pixel off every disparity moves the road's profile down by one pixel of it: pitch by h / (b f)."""
    source = sc.open_source(DRIVE)
    frame, config = source[0], sc.PipelineConfig(method="paper")
    roads = []
    for matcher in (None, Counting(), Counting(by=-1.0)):
        road = sc.FrontEnd(source.camera, config, matcher).step(frame).road
        assert road is not None
        roads.append(road.extrinsics)
    assert roads[0] == roads[1]
    expected = roads[0].height_m / (source.camera.baseline_m * source.camera.focal_px)
    assert abs(roads[2].pitch_rad - roads[0].pitch_rad) == pytest.approx(expected, rel=0.10)


def test_matchers_that_are_none_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, words in (
        ("warp", "unknown matcher"),
        ("json:nothing", "cannot be loaded"),
        ("sys:path", "no matcher"),
    ):
        assert main(["run", DRIVE, "--out", str(tmp_path / "out"), "--matcher", name]) == 2
        assert words in capsys.readouterr().err
        assert not (tmp_path / "out").exists()


def test_the_face_is_whole_and_costs_nothing_until_it_is_used() -> None:
    for name in sc.__all__:
        assert getattr(sc, name) is not None
    assert set(sc.__all__) <= set(dir(sc))
    with pytest.raises(AttributeError):
        _ = sc.nonsense
    code = "import sys, stereocalib_core; print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
