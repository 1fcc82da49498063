"""Plain folders and their camera.yaml, rectification included."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from drive_writer import BASELINE, CAMERA_YAML, HEIGHT, WIDTH, plain_drive, poses_text

from stereocalib_core.errors import SourceError
from stereocalib_core.geometry import rotation_x, rotation_y, rotation_z
from stereocalib_core.sources import SourceKind, open_source, source_kind
from stereocalib_core.sources.calibrations.own_yaml import read_camera_file


def test_reads_a_plain_folder(tmp_path: Path) -> None:
    folder = plain_drive(tmp_path / "d", camera=CAMERA_YAML + "fps: 20\ncx_right_px: 50.5\n")
    (folder / "poses.txt").write_text(poses_text(5))
    source = open_source(str(folder))
    assert source_kind(str(folder)) is SourceKind.FOLDER
    assert len(source) == 5
    assert source.camera.baseline_m == BASELINE
    assert source.camera.disparity_offset_px == pytest.approx(-3.0)
    np.testing.assert_allclose(source.timestamps_s, np.arange(5) / 20)
    assert source.ground_truth is not None
    assert source[4].left is not None
    assert source[4].left[0, 0] == 4


def test_unpadded_numbers_come_in_their_order(tmp_path: Path) -> None:
    source = open_source(str(plain_drive(tmp_path, [f"img{i}" for i in range(12)])))
    firsts = [frame.left[0, 0] for frame in map(source.__getitem__, range(12)) if frame.left is not None]
    assert firsts == list(range(12))


def test_names_that_are_times_or_every_other_number_make_no_gaps(tmp_path: Path) -> None:
    names = [str(1403636579763555584 + 50_000_000 * i) for i in range(5)]
    folder = plain_drive(tmp_path / "a", names)
    (folder / "times.txt").write_text("".join(f"{0.05 * i}\n" for i in range(5)))
    source = open_source(str(folder))
    assert len(source) == 5
    assert source.timestamps_s[4] == pytest.approx(0.2)
    assert len(open_source(str(plain_drive(tmp_path / "b", [f"{2 * i:04d}" for i in range(5)])))) == 5


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "no keys"),
        ("- 1\n- 2\n", "no keys"),
        ("width: [\n", "neither YAML nor JSON"),
        ("a: &x [1]\nb: *x\n", "aliases"),
        ("width: !!python/object/apply:os.system ['true']\n", "neither YAML nor JSON"),
        ("[" * 5000, "neither YAML nor JSON"),
        (CAMERA_YAML.replace("width: 96", "width: 1e9"), "width"),
        (CAMERA_YAML.replace("width: 96", "width: 96.5"), "width"),
        (CAMERA_YAML.replace("width: 96", "width: true"), "width"),
        (CAMERA_YAML.replace("width: 96", "width: 97"), "do not fit"),
        (CAMERA_YAML.replace("focal_px: 80.0", "focal_px: .nan"), "focal_px"),
        (CAMERA_YAML.replace("focal_px: 80.0", "focal_px: 'eighty'"), "focal_px"),
        (CAMERA_YAML.replace("focal_px: 80.0\n", ""), "focal_px"),
        (CAMERA_YAML.replace("focal_px: 80.0", f"focal_px: {'9' * 5000}"), ""),
        (CAMERA_YAML.replace("baseline_m: 0.5", "baseline_m: -0.5"), "baseline_m"),
        (CAMERA_YAML + "focus: 3\n", "focus"),
        ("#" * 300_000, "too large"),
    ],
)
def test_hostile_camera_files_are_one_clear_line(tmp_path: Path, text: str, part: str) -> None:
    with pytest.raises(SourceError) as caught:
        open_source(str(plain_drive(tmp_path, camera=text)))
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


def test_no_camera_file(tmp_path: Path) -> None:
    folder = plain_drive(tmp_path)
    (folder / "camera.yaml").unlink()
    with pytest.raises(SourceError, match=r"camera\.yaml"):
        open_source(str(folder))


# --- rectification: a point cloud seen by a distorted, twisted pair must come out on equal rows

SIZE = (640, 480)
K_LEFT = np.array([[500.0, 0, 318], [0, 505.0, 242], [0, 0, 1]])
K_RIGHT = np.array([[495.0, 0, 322], [0, 498.0, 238], [0, 0, 1]])
D_LEFT, D_RIGHT = np.array([-0.12, 0.03, 1e-3, -5e-4, 0.0]), np.array([-0.1, 0.02, -5e-4, 8e-4, 0.0])
R = rotation_x(0.02) @ rotation_y(-0.03) @ rotation_z(0.015)
T = np.array([-0.4, 0.004, 0.006])


def raw_camera_yaml(model: str = "pinhole", extra: str = "") -> str:
    count = 4 if model == "fisheye" else 5
    return (
        f"model: {model}\nwidth: {SIZE[0]}\nheight: {SIZE[1]}\n{extra}"
        f"left: {{K: {K_LEFT.tolist()}, D: {D_LEFT[:count].tolist()}}}\n"
        f"right: {{K: {K_RIGHT.tolist()}, D: {D_RIGHT[:count].tolist()}}}\n"
        f"R: {R.tolist()}\nt: {T.tolist()}\n"
    )


def seen(model: str, points: np.ndarray, K: np.ndarray, D: np.ndarray) -> np.ndarray:
    """(N, 3) points in a raw camera's frame to (N, 2) raw pixels."""
    if model == "fisheye":
        return cv2.fisheye.projectPoints(points.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), K, D[:4])[0][
            :, 0
        ]
    return cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, D)[0][:, 0]


@pytest.mark.parametrize("model", ["pinhole", "fisheye"])
@pytest.mark.parametrize("extra", ["", "focal_px: 450\ncx_px: 320\ncy_px: 240\n"])
def test_rectified_points_share_rows_and_give_their_depth(tmp_path: Path, model: str, extra: str) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(raw_camera_yaml(model, extra))
    described = read_camera_file(path)
    camera, rectifier = described.camera, described.rectifier
    assert rectifier is not None
    assert camera.baseline_m == pytest.approx(np.linalg.norm(T))
    if extra:
        assert camera.focal_px == 450
    points = np.array([[x, y, z] for x in (-1.0, 0.2, 1.1) for y in (-0.7, 0.1, 0.6) for z in (4.0, 6.0)])
    found = []
    sides = ((points, K_LEFT, D_LEFT, True), (points @ R.T + T, K_RIGHT, D_RIGHT, False))
    for cloud, K, D, is_left in sides:
        spots = []
        for u, v in seen(model, cloud, K, D):
            rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
            blob = 255 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / (2 * 3.0**2))
            image = blob.round().astype(np.uint8)
            both = rectifier.apply(image, image)
            moved = both[0 if is_left else 1].astype(float)
            spots.append(((moved * columns).sum() / moved.sum(), (moved * rows).sum() / moved.sum()))
        found.append(np.array(spots))
    left, right = found
    assert np.abs(left[:, 1] - right[:, 1]).max() < 0.08
    # Distance from the left camera's centre does not depend on its axes.
    back = camera.back_project(left[:, 0], left[:, 1], left[:, 0] - right[:, 0])
    np.testing.assert_allclose(np.linalg.norm(back, axis=1), np.linalg.norm(points, axis=1), rtol=0.01)


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("t: [-0.4", "t: [0.4", "right camera"),
        ("t: [-0.4, 0.004", "t: [-0.4, 3.0", "right camera"),
        (f"R: {R.tolist()}", f"R: {(2 * R).tolist()}", "no rotation"),
        (f"R: {R.tolist()}\n", "", "R is missing"),
        ("model: pinhole", "model: magic", "unknown model"),
        ("model: pinhole", "model: pinhole\nbaseline_m: 4e9", "baseline_m"),
        ("model: pinhole", "model: pinhole\nbaseline_m: 0.8", "disagree"),
        ("505.0", "-505.0", "camera matrix"),
        ("right: {K", "right: {Q", "K is missing"),
        ("right: ", "rigth: ", "unknown key"),
    ],
)
def test_bad_rectification_is_one_clear_line(tmp_path: Path, old: str, new: str, part: str) -> None:
    text = raw_camera_yaml()
    assert old in text
    path = tmp_path / "camera.yaml"
    path.write_text(text.replace(old, new))
    with pytest.raises(SourceError) as caught:
        read_camera_file(path)
    assert part in str(caught.value)


def test_sizes_of_the_maps(tmp_path: Path) -> None:
    assert (WIDTH, HEIGHT) != SIZE
    path = tmp_path / "camera.yaml"
    path.write_text(raw_camera_yaml())
    camera = read_camera_file(path).camera
    assert (camera.width, camera.height) == SIZE
