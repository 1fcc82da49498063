"""What people bring: other formats, other names, and inputs that are wrong; each is read, or its cause is named."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from stereocalib_app.cli.main import main

from stereocalib_core.boards.answer import judge
from stereocalib_core.boards.board_search import BoardCandidate
from stereocalib_core.boards.calibrate import calibrate
from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.chessboard import find_corners
from stereocalib_core.boards.cloud_files import read_cloud
from stereocalib_core.boards.detect import Detection
from stereocalib_core.boards.findings import findings
from stereocalib_core.boards.folder import open_folder
from stereocalib_core.boards.observation import BoardSpec
from stereocalib_core.boards.outline import Outline
from stereocalib_core.boards.pattern import true_pattern
from stereocalib_core.boards.shuffled import shuffled_clouds
from stereocalib_core.boards.synth import BOARD, CAMERA, T_CAMERA_LIDAR, SynthSettings, write_set
from stereocalib_core.boards.synthetic_picture import draw_in_view, render
from stereocalib_core.errors import SourceError
from stereocalib_core.experiments import lidar_camera_simulation as paper
from stereocalib_core.numeric.arrays import Array


@pytest.fixture(scope="module")
def cloud() -> Array:
    """A sweep in file order: neighbours in it are neighbours in space."""
    azimuth = np.linspace(-np.pi, np.pi, 400)
    rows = [
        np.stack([5 * np.cos(azimuth), 5 * np.sin(azimuth), np.full(400, z)], axis=1)
        for z in (-0.5, 0.0, 0.4)
    ]
    return np.concatenate(rows).astype(np.float32).astype(np.float64)


@pytest.mark.parametrize("width", [3, 4, 5, 6, 8])
def test_bin_records_of_any_width_are_recognised(cloud: Array, width: int, tmp_path: Path) -> None:
    extra = np.random.default_rng(0).uniform(0, 255, (len(cloud), 5))
    path = tmp_path / "a.bin"
    np.column_stack([cloud, extra])[:, :width].astype("<f4").tofile(path)
    np.testing.assert_allclose(read_cloud(path), cloud, atol=1e-6)


@pytest.mark.parametrize("factor", [1000.0, 100.0])
def test_clouds_in_other_units_are_refused_as_such(cloud: Array, factor: float, tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", cloud * factor)
    with pytest.raises(SourceError, match="not in metres"):
        read_cloud(tmp_path / "a.npy")


def test_text_with_decimal_commas_capital_fields_and_utf16(cloud: Array, tmp_path: Path) -> None:
    lines = [";".join(f"{v:.4f}".replace(".", ",") for v in row) for row in cloud]
    (tmp_path / "a.txt").write_text("X;Y;Z\n" + "\n".join(lines))
    np.testing.assert_allclose(read_cloud(tmp_path / "a.txt"), cloud, atol=1e-4)
    blanks = [" ".join(f"{v:.4f}".replace(".", ",") for v in row) for row in cloud]
    (tmp_path / "b.xyz").write_bytes("\n".join(blanks).encode("utf-16"))
    np.testing.assert_allclose(read_cloud(tmp_path / "b.xyz"), cloud, atol=1e-4)
    commas = [", ".join(f"{v:.4f}" for v in row) for row in cloud]
    (tmp_path / "c.csv").write_text("\n".join(commas))
    np.testing.assert_allclose(read_cloud(tmp_path / "c.csv"), cloud, atol=1e-4)
    (tmp_path / "d.pts").write_text(
        f"{len(cloud)}\n" + "\n".join(" ".join(f"{v:.4f}" for v in r) for r in cloud)
    )
    np.testing.assert_allclose(read_cloud(tmp_path / "d.pts"), cloud, atol=1e-4)


def test_capital_fields_of_pcd_and_ply(cloud: Array, tmp_path: Path) -> None:
    rows = "\n".join(" ".join(f"{v:.5f}" for v in row) for row in cloud)
    count = len(cloud)
    (tmp_path / "a.pcd").write_text(
        f"VERSION .7\nFIELDS X Y Z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {count}\nHEIGHT 1\n"
        f"POINTS {count}\nDATA ascii\n{rows}\n"
    )
    axes = "\n".join(f"property float {axis}" for axis in "XYZ")
    (tmp_path / "a.ply").write_text(
        f"ply\nformat ascii 1.0\nelement vertex {count}\n{axes}\nend_header\n{rows}\n"
    )
    for name in ("a.pcd", "a.ply"):
        np.testing.assert_allclose(read_cloud(tmp_path / name), cloud, atol=1e-4)


def test_las(cloud: Array, tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy", reason="laspy is an extra: pip install 'stereocalib[las]'")
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales = np.full(3, 0.0001)
    record = laspy.LasData(header)
    record.x, record.y, record.z = cloud.T
    record.write(str(tmp_path / "a.las"))
    np.testing.assert_allclose(read_cloud(tmp_path / "a.las"), cloud, atol=1e-3)
    (tmp_path / "b.las").write_bytes((tmp_path / "a.las").read_bytes()[:200])
    with pytest.raises(SourceError, match="damaged"):
        read_cloud(tmp_path / "b.las")


def settings_into(folder: Path) -> None:
    camera = {"model": "pinhole", "width": CAMERA.width, "height": CAMERA.height, "K": CAMERA.K.tolist()}
    (folder / "camera.yaml").write_text(yaml.safe_dump(camera))
    (folder / "board.yaml").write_text("columns: 7\nrows: 5\nsquare_m: '0,11'\n")


def test_names_that_end_in_the_same_number_pair_up(tmp_path: Path) -> None:
    for name in ("images", "clouds"):
        (tmp_path / name).mkdir()
    for n in (1, 2, 13):
        (tmp_path / "images" / f"left_{n:02d}.bmp").write_bytes(b"x")
        (tmp_path / "clouds" / f"scan{n:05d}.txt").write_bytes(b"x")
    settings_into(tmp_path)
    folder = open_folder(tmp_path)
    assert folder.names == ("left_01", "left_02", "left_13")
    assert folder.clouds["left_13"].name == "scan00013.txt"
    assert "pair up by the number" in folder.notes[0]
    assert folder.board.square_m == 0.11


def test_squares_counted_as_corners_are_told_from_the_pictures() -> None:
    rng = np.random.default_rng(1)
    pictures = [render(CAMERA, BOARD, draw_in_view(rng, CAMERA, BOARD), rng) for _ in range(2)]
    board, note = true_pattern(pictures, BoardSpec(8, 6, 0.11))
    assert (board.columns, board.rows) == (7, 5)
    assert "counts squares" in note
    assert "columns: 7, rows: 5" in note
    assert (board.width_m, board.height_m) == (BOARD.width_m, BOARD.height_m)
    assert true_pattern(pictures, BOARD) == (BOARD, "")
    assert true_pattern([np.full((400, 600), 90, np.uint8)], BoardSpec(8, 6, 0.11))[1] == ""


def test_a_board_without_a_white_rim_is_found_where_equalised_greys_hide_it(tmp_path: Path) -> None:
    write_set(tmp_path, SynthSettings(pairs=4, seed=2))
    picture = cv2.imread(str(tmp_path / "images" / "pair03.png"), cv2.IMREAD_GRAYSCALE)
    corners = find_corners(np.asarray(picture, np.uint8), BOARD)
    assert corners is not None
    truth = json.loads((tmp_path / "truth.json").read_text())
    T = np.array(truth["T_camera_board"][3])
    model = BOARD.corners_board * truth["square_m"] / BOARD.square_m
    np.testing.assert_allclose(corners, CAMERA.project(model @ T[:3, :3].T + T[:3, 3]), atol=0.3)


def detection(order: list[int], camera: BoardCamera = paper.CAMERA) -> Detection:
    """The paper's boards, the cloud of pair i being that of board order[i]."""
    boards = paper.simulate_boards(len(order), np.random.default_rng(4), paper.SimulatedNoise(0.3, 0.01))
    places = []
    for i in order:
        plane = boards[i].lidar_plane
        assert plane is not None
        places.append((BoardCandidate(plane.plane, Outline(plane.center, np.eye(3)[:2], 0.9), 0.05),))
    refused = [
        replace(o, status="rejected", reason="no board in the cloud where the picture has it: x")
        if i != order[i]
        else o
        for i, o in enumerate(boards)
    ]
    return Detection(paper.BOARD, camera, tuple(refused), None, (), tuple(places))


def test_clouds_in_another_order_are_matched_to_their_pictures() -> None:
    order = [1, 2, 3, 4, 5, 6, 7, 0]
    found = detection(order)
    names = [o.name for o in found.observations]
    assert shuffled_clouds(found) == {names[i]: names[k] for i, k in enumerate(order)}
    assert "clouds fit other pictures" in findings(found, None)[0].cause
    assert shuffled_clouds(detection(list(range(8)))) == {}


def test_pictures_and_clouds_of_different_poses_have_one_cause_in_front() -> None:
    seen, other = (
        paper.simulate_boards(8, np.random.default_rng(seed), paper.SimulatedNoise(0.3, 0.01))
        for seed in (4, 5)
    )
    mixed = tuple(
        replace(a, points_lidar=b.points_lidar, lidar_plane=b.lidar_plane)
        for a, b in zip(seen, other, strict=True)
    )
    result = calibrate(mixed, paper.BOARD, paper.CAMERA)
    answer = judge(Detection(paper.BOARD, paper.CAMERA, mixed), result)
    assert not answer.trusted
    assert answer.why.startswith("picture and cloud do not show the same pose")
    assert "take both while the board stands still" in answer.why
    assert "add a board" not in answer.why
    # Unknown is a metre and a radian, not a number without sense.
    assert np.sqrt(np.diag(result.covariance)).max() < 20.0


@pytest.mark.parametrize(("count", "trusted"), [(6, False), (14, True)])
def test_a_camera_from_few_boards_is_not_to_be_trusted(count: int, trusted: bool) -> None:
    seen = paper.simulate_boards(count, np.random.default_rng(6), paper.SimulatedNoise(0.1, 0.01))
    result = calibrate(seen, paper.BOARD, paper.CAMERA, with_intrinsics=True)
    answer = judge(Detection(paper.BOARD, paper.CAMERA, tuple(seen)), result)
    assert answer.trusted == trusted, answer.why
    if not trusted:
        assert answer.calibration.verdict == "weak"
        assert f"the camera is estimated from {count} boards that span" in answer.why


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("boards") / "set"
    write_set(folder, SynthSettings(pairs=7, seed=5, print_sigma=0.0, centre_sigma_m=0.0, beam_sigma_m=0.002))
    return folder


FIVE = ["--pairs", "pair00,pair01,pair02,pair03,pair04"]
"""Enough to name a cause by."""


def changed(rendered: Path, target: Path) -> Path:
    shutil.copytree(rendered, target)
    return target


def test_the_answer_is_printed_and_written(
    rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(["lidar-camera", str(rendered), "--out", str(tmp_path / "out")])
    told = capsys.readouterr().out
    assert code == 0, told
    for words in (
        "verdict: good",
        "T_camera_lidar takes LiDAR points into the camera",
        "T_lidar_camera takes points of that camera frame",
        "1 sigma",
        "a pair that had no say",
        "7 of 7 pairs used",
        "a square; the LiDAR measures",
        "report.md",
    ):
        assert words in told
    values = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert values["board_scale"]["value"] == pytest.approx(1.0, abs=4 * values["board_scale"]["sigma"])
    assert values["intrinsics"] is None
    gap = np.array(values["T_camera_lidar"])[:3, 3] - T_CAMERA_LIDAR[:3, 3]
    assert np.all(np.abs(gap) < 4 * np.array(values["sigma_translation_m"]))
    assert "verdict: good" in (tmp_path / "out" / "report.md").read_text()[:400]


def test_a_wrong_square_is_named_and_not_to_be_trusted(
    rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = changed(rendered, tmp_path / "set")
    (folder / "board.yaml").write_text(
        "columns: 7\nrows: 5\nsquare_m: 0.116\nwidth_m: 0.88\nheight_m: 0.66\n"
    )
    assert main(["lidar-camera", str(folder), "--out", str(tmp_path / "out")]) == 3
    said = capsys.readouterr()
    assert "board.yaml says 0.116" in said.err
    measured = float(said.err.split("measure ")[1].split()[0])
    assert measured == pytest.approx(BOARD.square_m, abs=0.0005)


def test_clouds_in_millimetres_end_with_their_cause_and_every_reason_written(
    rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = changed(rendered, tmp_path / "set")
    for path in (folder / "clouds").iterdir():
        (np.fromfile(path, "<f4") * np.float32(1000)).tofile(path)
    assert main(["lidar-camera", str(folder), "--out", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert "not in metres" in err
    assert err.count("\n") == 1
    values = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert len(values["pairs"]) == 7
    assert all("not in metres" in p["reason"] for p in values["pairs"])
    assert values["T_camera_lidar"] is None


def test_k_of_another_resolution_is_named_with_its_factor(
    rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = changed(rendered, tmp_path / "set")
    values = yaml.safe_load((folder / "camera.yaml").read_text())
    values["K"] = (np.array(values["K"]) * [[0.5], [0.5], [1.0]]).tolist()
    (folder / "camera.yaml").write_text(yaml.safe_dump(values))
    assert main(["lidar-camera", str(folder), "--out", str(tmp_path / "out"), *FIVE]) in (2, 3)
    err = capsys.readouterr().err
    assert "K is for pictures of about 4" in err
    assert "multiply K by" in err


def test_another_lens_model_is_named(
    rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = changed(rendered, tmp_path / "set")
    values = yaml.safe_load((folder / "camera.yaml").read_text())
    values |= {"model": "fisheye", "D": [0.4, 0.6, -0.2, 0.1]}
    (folder / "camera.yaml").write_text(yaml.safe_dump(values))
    assert main(["lidar-camera", str(folder), "--out", str(tmp_path / "out"), *FIVE]) in (2, 3)
    assert "the lens in camera.yaml (fisheye) does not fit" in capsys.readouterr().err


def test_pictures_in_other_formats_give_the_same(
    rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = changed(rendered, tmp_path / "set")
    for path, suffix in zip(
        sorted((folder / "images").iterdir()), (".bmp", ".tif", ".webp") * 3, strict=False
    ):
        picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        cv2.imwrite(str(path.with_suffix(suffix)), picture, [cv2.IMWRITE_WEBP_QUALITY, 101])
        path.unlink()
    three = "pair00,pair01,pair02"
    assert main(["lidar-camera", str(folder), "--out", str(tmp_path / "out"), "--pairs", three]) == 3
    values = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert [p["status"] for p in values["pairs"]] == ["ok"] * 3
    # three poses leave nothing to check them with: the answer says which fourth would help most
    assert f"next: {values['next_pose']['words']}" in capsys.readouterr().out
    assert max(values["next_pose"]["sigma_translation_m"]) < max(values["sigma_translation_m"])
