"""From files to the transform in rooms with known truth: walls, furniture, someone at the board's edge."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from lidar_scenes import FLU_TO_RDF, Rectangle, cast, dense, hdl64, room, vlp16, write_folder

from stereocalib_core.boards import (
    BoardCamera,
    BoardSpec,
    Calibration,
    calibrate,
    detect,
    open_folder,
)
from stereocalib_core.boards.board_search import find_candidates
from stereocalib_core.boards.rotations import rotation_angle, rotation_from_vector
from stereocalib_core.errors import ConfigError, SourceError
from stereocalib_core.geometry import invert_transform, transform
from stereocalib_core.run.boards import run

CAMERA = BoardCamera(
    "pinhole",
    800,
    560,
    np.array([[600.0, 0, 400], [0, 600, 280], [0, 0, 1]]),
    np.array([-0.2, 0.06, 0.0004, -0.0003]),
)
TRUTH = transform(
    rotation_from_vector(np.deg2rad([2.0, -3.0, 1.0])) @ FLU_TO_RDF, np.array([0.1, -0.25, -0.15])
)


def errors(result: Calibration) -> tuple[float, float]:
    turn = np.rad2deg(rotation_angle(result.T_camera_lidar[:3, :3].T @ TRUTH[:3, :3]))
    return turn, float(np.linalg.norm(result.T_camera_lidar[:3, 3] - TRUTH[:3, 3]))


@pytest.mark.parametrize(
    ("rays", "board", "suffix"),
    [
        (vlp16, BoardSpec(7, 7, 0.10), ".bin"),
        (hdl64, BoardSpec(7, 5, 0.11), ".npy"),
        (dense, BoardSpec(8, 6, 0.09), ".bin"),
    ],
    ids=["vlp16-symmetric", "hdl64", "dense"],
)
def test_boards_are_found_among_clutter(tmp_path: Path, rays: object, board: BoardSpec, suffix: str) -> None:
    write_folder(tmp_path / "set", CAMERA, board, TRUTH, rays(), 5, seed=4, suffix=suffix)  # type: ignore[operator]
    found = detect(open_folder(tmp_path / "set"))
    result = calibrate(found.observations, found.board, found.camera)
    assert sum(p.ok for p in result.pairs) >= 5, [p.reason for p in result.pairs]
    turn_deg, shift_m = errors(result)
    assert turn_deg < 0.7
    assert shift_m < 0.03
    # The report's own sigma must cover the error.
    gap = result.T_camera_lidar[:3, 3] - TRUTH[:3, 3]
    assert np.all(np.abs(gap) < 5 * result.sigma_translation_m + 0.003)


def test_a_room_without_a_board_holds_nothing_like_one() -> None:
    rng = np.random.default_rng(0)
    cloud = cast(vlp16(), room()[:6], 0.02, rng)
    assert all(c.outline.score < 0.85 for c in find_candidates(cloud, BoardSpec(8, 6, 0.1), 12.0))


def test_a_poster_on_a_wall_and_a_bigger_panel_are_no_boards() -> None:
    rng = np.random.default_rng(0)
    board = BoardSpec(7, 5, 0.1)
    facing = FLU_TO_RDF.T
    poster = Rectangle(transform(facing, np.array([8.48, 0.0, 0.0])), 0.8, 0.6)
    panel = Rectangle(transform(facing, np.array([3.0, 0.5, 0.0])), 1.6, 1.2)
    board_at = Rectangle(transform(facing, np.array([3.0, -1.5, 0.0])), 0.8, 0.6)
    cloud = cast(hdl64(), [*room()[:6], poster, panel], 0.015, rng)
    assert [c for c in find_candidates(cloud, board, 10.0) if c.outline.score > 0.85] == []
    cloud = cast(hdl64(), [*room()[:6], poster, panel, board_at], 0.015, rng)
    best = find_candidates(cloud, board, 10.0)[0]
    assert best.outline.score > 0.85
    np.testing.assert_allclose(best.outline.center, board_at.T[:3, 3], atol=0.04)


def test_unusable_pairs_are_named_and_the_rest_goes_on(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    board = BoardSpec(7, 5, 0.11)
    write_folder(folder, CAMERA, board, TRUTH, vlp16(), 8, seed=9, held=False)
    rng = np.random.default_rng(0)
    (folder / "clouds" / "pair00.bin").write_bytes((folder / "clouds" / "pair00.bin").read_bytes()[:-7])
    empty = cast(vlp16(), room(), 0.02, rng)
    np.column_stack([empty, np.zeros(len(empty))]).astype("<f4").tofile(folder / "clouds" / "pair01.bin")
    (folder / "images" / "pair02.png").rename(folder / "images" / "other.png")
    (folder / "images" / "pair03.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"0" * 50)
    out = tmp_path / "out"
    out.mkdir()
    result = run(folder, out, None, None, False).calibration
    reasons = {p.name: p.reason for p in result.pairs if not p.ok}
    assert set(reasons) == {"pair00", "pair01", "pair02", "pair03", "other"}
    assert "cut off" in reasons["pair00"]
    assert "no board in the cloud" in reasons["pair01"]
    assert reasons["pair02"] == "no picture of this name"
    assert reasons["other"] == "no cloud of this name"
    assert "cannot be read" in reasons["pair03"]
    assert all("\n" not in r for r in reasons.values())
    turn_deg, shift_m = errors(result)
    assert turn_deg < 0.8
    assert shift_m < 0.04
    assert {p.name for p in out.iterdir()} >= {
        "calibration.json",
        "overlay_pair04.png",
        "residuals.png",
        "iterations.png",
    }


def test_intrinsics_can_be_estimated_from_the_boards(tmp_path: Path) -> None:
    write_folder(
        tmp_path / "set",
        CAMERA,
        BoardSpec(7, 5, 0.11),
        TRUTH,
        vlp16(),
        9,
        seed=2,
        model="estimate",
        held=False,
    )
    found = detect(open_folder(tmp_path / "set"))
    assert found.estimated_rms_px is not None
    assert found.estimated_rms_px < 0.3
    result = calibrate(found.observations, found.board, found.camera)
    turn_deg, shift_m = errors(result)
    assert turn_deg < 1.0
    assert shift_m < 0.05


def test_the_inverse_goes_the_other_way() -> None:
    assert np.allclose(invert_transform(TRUTH) @ TRUTH, np.eye(4))


def test_unusable_folders_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(SourceError):
        open_folder(tmp_path / "nowhere")
    for name in ("images", "clouds"):
        (tmp_path / name).mkdir()
    with pytest.raises(SourceError, match="no pictures"):
        open_folder(tmp_path)
    (tmp_path / "images" / "a.png").write_bytes(b"x")
    with pytest.raises(ConfigError):
        open_folder(tmp_path)
    (tmp_path / "board.yaml").write_text("columns: 7\nrows: 5.5\nsquare_m: 0.1\n")
    (tmp_path / "camera.yaml").write_text("model: estimate\n")
    with pytest.raises(ConfigError, match="whole number"):
        open_folder(tmp_path)
    for hostile in (".inf", "2024-99-99", "[1, 2]", "&a [*a, *a]"):
        (tmp_path / "board.yaml").write_text(f"columns: {hostile}\nrows: 5\nsquare_m: 0.1\n")
        with pytest.raises(ConfigError, match=r"board\.yaml"):
            open_folder(tmp_path)
    (tmp_path / "board.yaml").write_text("columns: 7\nrows: 5\nsquare_m: 0.1\n")
    with pytest.raises(SourceError, match="no pair named 'b'"):
        open_folder(tmp_path, pairs=["b"])
    (tmp_path / "camera.yaml").write_text("model: pinhole\nwidth: 640\nheight: 480\nK: [[1, 2], [3]]\n")
    with pytest.raises(ConfigError) as error:
        open_folder(tmp_path)
    assert "\n" not in str(error.value)
