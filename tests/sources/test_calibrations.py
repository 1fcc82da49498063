"""Calibrations: every dialect read, written, and the same there and back; OpenCV and yaml read what we write."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from stereocalib_core.calibration import (
    Lens,
    LensPair,
    RectifiedPair,
    StereoCalibration,
    rectifying_rotations,
    rotation_angle,
)
from stereocalib_core.errors import SourceError
from stereocalib_core.geometry import rotation_x, rotation_y, rotation_z
from stereocalib_core.sources.calibrations import WRITERS, read_calibration, write_calibration
from stereocalib_core.sources.calibrations.rectify import opened

SIZE = (1226, 370)
RECTIFIED = RectifiedPair(707.0912, 601.8873, 183.1104, 0.5371507, 610.25, SIZE)
K_LEFT = np.array([[712.5, 0, 611.25], [0, 711.75, 187.5], [0, 0, 1]])
K_RIGHT = np.array([[709.1, 0, 605.5], [0, 710.3, 182.0], [0, 0, 1]])
R = rotation_x(0.012) @ rotation_y(-0.02) @ rotation_z(0.007)
T = np.array([-0.5371507, 0.0031, -0.0047])


def lenses(model: str = "pinhole", D: list[float] | None = None) -> LensPair:
    D_left = np.array(D or [-0.11, 0.021, 4e-4, -6e-4])
    D_right = 0.9 * D_left
    left, right = (Lens(K, d, model) for K, d in ((K_LEFT, D_left), (K_RIGHT, D_right)))  # type: ignore[arg-type]
    return LensPair(left, right, R, T, SIZE)


CASES = {
    "rectified": StereoCalibration(None, RECTIFIED, False),
    "raw": StereoCalibration(lenses(), None, True),
    "fisheye": StereoCalibration(lenses("fisheye", [0.01, -0.02, 0.003, -4e-4]), None, True),
    "rational": StereoCalibration(lenses(D=[0.4, -0.3, 1e-4, 2e-4, 0.02, 0.5, -0.2, 0.01]), None, True),
    "k3": StereoCalibration(lenses(D=[-0.3, 0.1, 1e-4, 2e-4, 0.02]), None, True),
}
CANNOT = {("fisheye", "kitti"), ("rational", "kitti"), ("rational", "kalibr"), ("k3", "kalibr")}
SUFFIXES = {
    "yaml": [".yaml"],
    "opencv": [".yml", ".xml", ".json"],
    "ros": [".yaml"],
    "kalibr": [".yaml"],
    "kitti": [".txt"],
}
WAYS = [(case, dialect, suffix) for case in CASES for dialect in WRITERS for suffix in SUFFIXES[dialect]]


def same(a: StereoCalibration, b: StereoCalibration) -> None:
    """Equal to 1e-9, lens by lens and the rectified pair."""
    assert a.raw_pictures == b.raw_pictures
    pairs = a.pictured(), b.pictured()
    for name in ("left", "right"):
        one, two = (getattr(pair, name) for pair in pairs)
        assert one.model == two.model
        np.testing.assert_allclose(one.K, two.K, rtol=0, atol=1e-9)
        np.testing.assert_allclose(one.padded(), two.padded(), rtol=0, atol=1e-9)
    np.testing.assert_allclose(pairs[0].R, pairs[1].R, rtol=0, atol=1e-9)
    np.testing.assert_allclose(pairs[0].t, pairs[1].t, rtol=0, atol=1e-9)
    assert pairs[0].size == pairs[1].size
    if a.rectified is not None:
        assert b.rectified is not None
        for P, Q in zip(a.rectified.projections(), b.rectified.projections(), strict=True):
            np.testing.assert_allclose(P, Q, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("case", "dialect", "suffix"), WAYS)
def test_there_and_back(tmp_path: Path, case: str, dialect: str, suffix: str) -> None:
    calibration, path = CASES[case], tmp_path / f"c{suffix}"
    if (case, dialect) in CANNOT:
        with pytest.raises(SourceError, match="no place for"):
            write_calibration(calibration, dialect, path)
        assert list(tmp_path.iterdir()) == []
        return
    written = write_calibration(calibration, dialect, path)
    back = read_calibration(",".join(map(str, written)) if dialect == "ros" else path).calibration
    if dialect == "kitti" and calibration.raw_pictures:
        # KITTI's own pictures are rectified; its raw lenses are told by the size of the pictures
        assert not back.raw_pictures
        assert back.lenses is not None
        back = StereoCalibration(back.lenses, back.rectified, True)
    same(calibration, back)
    assert back.size == SIZE
    second = tmp_path / "again"
    write_calibration(back, "yaml", second / "camera.yaml")
    same(back, read_calibration(second).calibration)


def test_a_folder_is_searched_whatever_the_files_are_called(tmp_path: Path) -> None:
    for dialect in WRITERS:
        folder = tmp_path / dialect
        folder.mkdir()
        (folder / "README.txt").write_text("recorded in May: see notes\n")
        (folder / "times.txt").write_text("".join(f"{0.1 * i}\n" for i in range(50)))
        for file in write_calibration(
            CASES["rectified"], dialect, folder / f"vendor_dump{SUFFIXES[dialect][0]}"
        ):
            assert file.is_file()
        same(CASES["rectified"], read_calibration(folder).calibration)


def storage(path: Path) -> cv2.FileStorage:
    store = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert store.isOpened()
    return store


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
def test_opencv_itself_reads_what_we_write(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"stereo{suffix}"
    write_calibration(CASES["raw"], "opencv", path)
    store = storage(path)
    np.testing.assert_array_equal(store.getNode("M1").mat(), K_LEFT)
    np.testing.assert_array_equal(store.getNode("M2").mat(), K_RIGHT)
    np.testing.assert_array_equal(store.getNode("R").mat(), R)
    np.testing.assert_array_equal(store.getNode("T").mat().ravel(), T)
    assert int(store.getNode("image_width").real()) == SIZE[0]
    R1, R2, P1, P2, Q = (store.getNode(name).mat() for name in ("R1", "R2", "P1", "P2", "Q"))
    # the rectification that we state is one: points of one scene come out on equal rows, at the depth that Q says
    points = np.array([[x, y, z] for x in (-2.0, 0.5, 3.0) for y in (-0.8, 0.2, 0.9) for z in (6.0, 25.0)])
    left = (P1[:, :3] @ (R1 @ points.T)).T
    right = (P2 @ np.vstack([R2 @ (R @ points.T + T[:, None]), np.ones(len(points))])).T
    right_pure = (P2[:, :3] @ (R2 @ (R @ points.T + T[:, None]))).T
    rows_left, rows_right = left[:, 1] / left[:, 2], right_pure[:, 1] / right_pure[:, 2]
    np.testing.assert_allclose(rows_left, rows_right, atol=1e-6)
    assert not np.allclose(right, right_pure)
    disparity = left[:, 0] / left[:, 2] - right_pure[:, 0] / right_pure[:, 2]
    back = np.column_stack([left[:, :2] / left[:, 2:], disparity, np.ones(len(points))]) @ Q.T
    np.testing.assert_allclose(back[:, :3] / back[:, 3:], (R1 @ points.T).T, rtol=1e-6)


def test_yaml_reads_what_we_write_for_ros_and_kalibr(tmp_path: Path) -> None:
    left, right = write_calibration(CASES["raw"], "ros", tmp_path / "ros")
    values = [yaml.safe_load(path.read_text()) for path in (left, right)]
    assert [v["camera_name"] for v in values] == ["left", "right"]
    assert values[0]["camera_matrix"]["data"] == K_LEFT.ravel().tolist()
    assert values[0]["distortion_model"] == "plumb_bob"
    assert len(values[0]["distortion_coefficients"]["data"]) == 5
    assert values[1]["projection_matrix"]["data"][3] < 0
    (chain,) = write_calibration(CASES["raw"], "kalibr", tmp_path / "chain.yaml")
    cam1 = yaml.safe_load(chain.read_text())["cam1"]
    np.testing.assert_array_equal(np.array(cam1["T_cn_cnm1"])[:3, 3], T)
    assert cam1["distortion_model"] == "radtan"
    assert cam1["intrinsics"] == [709.1, 710.3, 605.5, 182.0]


def test_opencvs_own_files_are_read(tmp_path: Path) -> None:
    """Written by OpenCV itself, intrinsics and extrinsics apart, in all three syntaxes."""
    for suffix in (".yml", ".xml", ".json"):
        folder = tmp_path / suffix[1:]
        folder.mkdir()
        pair = lenses()
        R1, R2, P1, P2, Q, _, _ = cv2.stereoRectify(
            K_LEFT, pair.left.D, K_RIGHT, pair.right.D, SIZE, R, T.reshape(3, 1), alpha=0
        )
        files = {
            "intrinsics": {"M1": K_LEFT, "D1": pair.left.D, "M2": K_RIGHT, "D2": pair.right.D},
            "extrinsics": {"R": R, "T": T, "R1": R1, "R2": R2, "P1": P1, "P2": P2, "Q": Q},
        }
        for name, matrices in files.items():
            store = cv2.FileStorage(str(folder / f"{name}{suffix}"), cv2.FILE_STORAGE_WRITE)
            for key, matrix in matrices.items():
                store.write(key, matrix)
            store.release()
        calibration = read_calibration(folder).calibration
        same(StereoCalibration(LensPair(pair.left, pair.right, R, T), None, True), calibration)
        assert calibration.rectified is not None
        assert calibration.rectified.focal_px == pytest.approx(P1[0, 0], abs=1e-9)
        one = read_calibration(folder / f"intrinsics{suffix}").calibration
        np.testing.assert_array_equal(one.pictured().R, calibration.pictured().R)


SPELLINGS = [
    ("K1", "D1", "K2", "D2", "R", "T"),
    ("cameraMatrix1", "distCoeffs1", "cameraMatrix2", "distCoeffs2", "R", "T"),
    ("camera_matrix_left", "dist_coeffs_left", "camera_matrix_right", "dist_coeffs_right", "R", "T"),
    (
        "left_camera_matrix",
        "left_distortion",
        "right_camera_matrix",
        "right_distortion",
        "rotation",
        "translation",
    ),
    ("KL", "DL", "KR", "DR", "R", "t"),
    ("K_0", "D_0", "K_1", "D_1", "R", "T"),
    ("mtxL", "distL", "mtxR", "distR", "Rot", "Trans"),
]


@pytest.mark.parametrize("names", SPELLINGS)
def test_spellings_of_opencvs_users(tmp_path: Path, names: tuple[str, ...]) -> None:
    pair = lenses()
    store = cv2.FileStorage(str(tmp_path / "a.yml"), cv2.FILE_STORAGE_WRITE)
    for name, value in zip(names, (K_LEFT, pair.left.D, K_RIGHT, pair.right.D, R, T), strict=True):
        store.write(name, value)
    store.release()
    same(
        StereoCalibration(LensPair(pair.left, pair.right, R, T), None, True),
        read_calibration(tmp_path).calibration,
    )


def test_one_opencv_file_a_camera_and_one_for_both(tmp_path: Path) -> None:
    pair = lenses()
    for name, K, D in (("left", K_LEFT, pair.left.D), ("right", K_RIGHT, pair.right.D)):
        store = cv2.FileStorage(str(tmp_path / f"{name}.yml"), cv2.FILE_STORAGE_WRITE)
        store.write("image_width", SIZE[0])
        store.write("image_height", SIZE[1])
        store.write("camera_matrix", K)
        store.write("distortion_coefficients", D)
        store.release()
    store = cv2.FileStorage(str(tmp_path / "both.yml"), cv2.FILE_STORAGE_WRITE)
    store.write("R", R)
    store.write("T", T)
    store.release()
    same(StereoCalibration(pair, None, True), read_calibration(tmp_path).calibration)


def test_other_shapes_of_the_same_things(tmp_path: Path) -> None:
    """camera_info as a message prints, EuRoC's sensor.yaml, ORB-SLAM's settings, KITTI's P_rect lines."""
    P_left, P_right = RECTIFIED.projections()
    message = tmp_path / "message"
    message.mkdir()
    for name, P in (("left", P_left), ("right", P_right)):
        text = f"header: {{seq: 1}}\nheight: {SIZE[1]}\nwidth: {SIZE[0]}\ndistortion_model: plumb_bob\n"
        text += f"d: []\nk: {P[:, :3].ravel().tolist()}\nr: [1,0,0,0,1,0,0,0,1]\np: {P.ravel().tolist()}\n"
        (message / f"{name}_info.yaml").write_text(text)
    same(CASES["rectified"], read_calibration(message).calibration)

    euroc = tmp_path / "mav0"
    T_body = np.eye(4)
    T_body[:3, :3], T_body[:3, 3] = rotation_z(0.3) @ rotation_x(1.2), [0.1, -0.2, 0.05]
    T_right_left = np.eye(4)
    T_right_left[:3, :3], T_right_left[:3, 3] = R, T
    for cam, K, D, T_BS in (
        ("cam0", K_LEFT, lenses().left.D, T_body),
        ("cam1", K_RIGHT, lenses().right.D, T_body @ np.linalg.inv(T_right_left)),
    ):
        (euroc / cam).mkdir(parents=True)
        text = "%YAML:1.0\n# General sensor definitions.\nsensor_type: camera\ncomment: VI-Sensor cam\n"
        text += f"T_BS:\n  cols: 4\n  rows: 4\n  data: {T_BS.ravel().tolist()}\nrate_hz: 20\n"
        text += f"resolution: [{SIZE[0]}, {SIZE[1]}]\ncamera_model: pinhole\n"
        text += f"intrinsics: [{K[0, 0]}, {K[1, 1]}, {K[0, 2]}, {K[1, 2]}] #fu, fv, cu, cv\n"
        text += f"distortion_model: radial-tangential\ndistortion_coefficients: {D.tolist()}\n"
        (euroc / cam / "sensor.yaml").write_text(text)
    same(CASES["raw"], read_calibration(euroc).calibration)

    orb = tmp_path / "orb.yaml"
    orb.write_text(
        '%YAML:1.0\nCamera.type: "PinHole"\nCamera.fx: 707.0912\nCamera.fy: 707.0912\nCamera.cx: 601.8873\n'
        "Camera.cy: 183.1104\nCamera.k1: 0.0\nCamera.width: 1226\nCamera.height: 370\nCamera.fps: 10.0\n"
        f"Camera.bf: {707.0912 * 0.5371507!r}\nThDepth: 40\n"
    )
    found = read_calibration(orb).calibration
    assert found.rectified is not None and found.fps == 10
    assert found.rectified.baseline_m == pytest.approx(0.5371507, abs=1e-12)

    lines = tmp_path / "calib.txt"
    lines.write_text(
        "".join(
            f"P_rect_0{i}: {' '.join(map(repr, P.ravel().tolist()))}\n"
            for i, P in ((2, P_left), (3, P_right))
        )
    )
    found = read_calibration(lines).calibration
    assert found.rectified is not None
    np.testing.assert_allclose(found.rectified.projections()[1], P_right, atol=1e-9)


MODELS = [
    ("equidistant", "fisheye"), ("fisheye", "fisheye"), ("kannala_brandt", "fisheye"), ("radtan", "pinhole"),
    ("plumb_bob", "pinhole"), ("radial-tangential", "pinhole"), ("Plumb Bob", "pinhole"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "model"), MODELS)
def test_names_of_lens_models(tmp_path: Path, name: str, model: str) -> None:
    (path,) = write_calibration(CASES["raw"], "yaml", tmp_path / "camera.yaml")
    path.write_text(path.read_text().replace("model: pinhole", f"model: {name}"))
    assert read_calibration(path).calibration.pictured().left.model == model


def test_encodings_and_numbers_as_they_come(tmp_path: Path) -> None:
    (path,) = write_calibration(CASES["rectified"], "yaml", tmp_path / "camera.yaml")
    text = path.read_text()
    forms = [
        b"\xef\xbb\xbf" + text.encode(),
        text.encode("utf-16"),
        text.encode("utf-16-le"),
        text.replace("707.0912", "7.070912e2").encode(),
        text.replace("707.0912", "707,0912").replace("0.5371507", "0,5371507").encode(),
        text.replace("\n", "\r\n").encode(),
        (text + "# caf\xe9\n").encode("latin-1"),
    ]
    for form in forms:
        path.write_bytes(form)
        same(CASES["rectified"], read_calibration(path).calibration)
    (path,) = write_calibration(CASES["rectified"], "kitti", tmp_path / "calib.txt")
    for form in (text.replace(".", ",") if False else path.read_text(), path.read_text().replace(".", ",")):
        path.write_bytes(b"\xef\xbb\xbf" + form.encode())
        same(CASES["rectified"], read_calibration(path).calibration)


@pytest.mark.parametrize(
    ("stated", "baseline", "said"),
    [
        ("537", 0.537, "taken as mm"),
        ("1200", 1.2, "taken as mm"),
        ("12", 0.12, "taken as cm"),
        ("3.5", 3.5, None),
    ],
)
def test_a_baseline_in_other_units(tmp_path: Path, stated: str, baseline: float, said: str | None) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(
        f"width: 1226\nheight: 370\nfocal_px: 707\ncx_px: 601\ncy_px: 183\nbaseline_m: {stated}\n"
    )
    found = read_calibration(path).calibration
    assert found.rectified is not None
    assert found.rectified.baseline_m == pytest.approx(baseline)
    assert [note for note in found.notes if said and said in note] == list(found.notes)


@pytest.mark.parametrize("stated", ["75", "53.7"])
def test_a_baseline_with_two_readings_is_asked_about(tmp_path: Path, stated: str) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(
        f"width: 1226\nheight: 370\nfocal_px: 707\ncx_px: 601\ncy_px: 183\nbaseline_m: {stated}\n"
    )
    with pytest.raises(SourceError, match="in cm or mm"):
        read_calibration(path)
    found = read_calibration(path, unit="cm").calibration
    assert found.rectified is not None
    assert found.rectified.baseline_m == pytest.approx(float(stated) / 100)


def test_the_left_camera_keeps_its_axes() -> None:
    """A right camera that is turned changes nothing of where the left one looks."""
    turned = rotation_x(0.02) @ rotation_y(0.01) @ rotation_z(-0.015)
    R_left, R_right = rectifying_rotations(turned, turned @ np.array([-0.54, 0.0, 0.0]))
    assert rotation_angle(R_left) == 0
    np.testing.assert_allclose(R_right, turned.T, atol=1e-12)


def test_a_mended_pair_says_where_its_right_camera_is() -> None:
    C = rotation_y(np.deg2rad(0.1)) @ rotation_x(np.deg2rad(-0.05))
    mended = CASES["rectified"].mended(C, scale=1.01)
    assert mended.raw_pictures and mended.rectified is not None
    pair = mended.pictured()
    np.testing.assert_allclose(pair.R, C, atol=1e-12)
    np.testing.assert_allclose(pair.t, C @ [-RECTIFIED.baseline_m * 1.01, 0, 0], atol=1e-12)
    assert pair.right.K[0, 2] == 610.25
    ready = opened(mended, SIZE, "here")
    assert ready.rectifier is not None
    assert ready.camera.focal_px == RECTIFIED.focal_px
    assert ready.camera.baseline_m == pytest.approx(1.01 * RECTIFIED.baseline_m)
    # from raw lenses the bend is on top of what they say already
    raw = CASES["raw"].mended(np.eye(3))
    np.testing.assert_allclose(raw.pictured().R, R, atol=1e-12)
    np.testing.assert_allclose(raw.pictured().t, T, atol=1e-12)
    R_left, R_right = rectifying_rotations(R, T)
    bent = CASES["raw"].mended(C)
    np.testing.assert_allclose(R_right @ bent.pictured().R @ R_left.T, C, atol=1e-12)


def test_the_command_converts_and_refuses_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from stereocalib_app.cli.main import main

    write_calibration(CASES["raw"], "kalibr", tmp_path / "in" / "some.yaml")
    out = tmp_path / "ros"
    assert main(["calibration", str(tmp_path / "in"), "--to", "ros", "--out", str(out)]) == 0
    assert "Kalibr camchain" in capsys.readouterr().out
    same(CASES["raw"], read_calibration(out).calibration)
    assert main(["calibration", str(tmp_path / "in"), "--to", "ros", "--out", str(out)]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert main(["calibration", str(tmp_path / "none"), "--to", "ros", "--out", str(out)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    text = "P0: 707 0 601 0 0 707 183 0 0 0 1 0\nP1: 707 0 601 -379 0 707 183 0 0 0 1 0\n"
    (tmp_path / "calib.txt").write_text(text)
    arguments = [
        "calibration",
        str(tmp_path / "calib.txt"),
        "--to",
        "yaml",
        "--out",
        str(tmp_path / "c.yaml"),
    ]
    assert main(arguments) == 2
    assert "--size" in capsys.readouterr().err
    assert main([*arguments, "--size", "1226x370"]) == 0
    assert read_calibration(tmp_path / "c.yaml").calibration.size == (1226, 370)


def test_the_output_of_a_run_gives_its_mended_calibration(tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text("{}")
    with pytest.raises(SourceError, match="mended"):
        read_calibration(tmp_path)
    mended = CASES["rectified"].mended(rotation_y(0.002))
    write_calibration(mended, "yaml", tmp_path / "calibration_mended.yaml")
    same(mended, read_calibration(tmp_path).calibration)


def test_opencv_in_millimetres(tmp_path: Path) -> None:
    """The unit of OpenCV's T is that of the board's squares; where both are possible, the source may say."""
    pair = lenses()
    for length, name in ((537.0, "clear"), (120.0, "open")):
        folder = tmp_path / name
        folder.mkdir()
        store = cv2.FileStorage(str(folder / "stereo.yml"), cv2.FILE_STORAGE_WRITE)
        values = {"M1": K_LEFT, "D1": pair.left.D, "M2": K_RIGHT, "D2": pair.right.D, "R": R}
        for key, value in {**values, "T": np.array([[-length], [1.0], [2.0]])}.items():
            store.write(key, value)
        store.release()
    found = read_calibration(tmp_path / "clear").calibration
    assert found.pictured().baseline_m == pytest.approx(0.537, abs=1e-3)
    assert any("taken as mm" in note for note in found.notes)
    with pytest.raises(SourceError, match="in cm or mm"):
        read_calibration(tmp_path / "open")
    assert read_calibration(tmp_path / "open", "mm").calibration.pictured().baseline_m == pytest.approx(
        0.12, abs=1e-3
    )


@pytest.mark.parametrize("form", ["folder", "kitti", "video"])
def test_a_calibration_that_is_named_takes_the_place_of_the_sources_own(tmp_path: Path, form: str) -> None:
    from drive_writer import CAMERA_YAML, odometry_drive, picture, plain_drive

    from stereocalib_core.sources import open_source, with_calibration

    other = tmp_path / "better.yaml"
    other.write_text(CAMERA_YAML.replace("focal_px: 80.0", "focal_px: 81.5"))
    if form == "folder":
        spec = str(plain_drive(tmp_path / "d"))
    elif form == "kitti":
        spec = str(odometry_drive(tmp_path / "d"))
    else:
        writer = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10, (192, 64))
        for i in range(3):
            both = np.hstack([picture(i, "left"), picture(i, "right")])
            writer.write(cv2.cvtColor(both, cv2.COLOR_GRAY2BGR))
        writer.release()
        (tmp_path / "camera.yaml").write_text(CAMERA_YAML)
        spec = f"video:{tmp_path / 'v.avi'}?camera=camera.yaml"
    own, named = open_source(spec), open_source(with_calibration(spec, other))
    assert own.camera.focal_px == 80.0
    assert named.camera.focal_px == 81.5
    assert named.content_key != own.content_key
    with pytest.raises(SourceError, match="knows its own"):
        with_calibration("synthetic", other)


def test_orb_slams_settings_of_an_unrectified_pair(tmp_path: Path) -> None:
    """As they are passed around: no blank before a matrix's data, the rectified camera beside the lenses."""
    pair = lenses()
    R1, R2, P1, P2, *_ = cv2.stereoRectify(
        K_LEFT, pair.left.D, K_RIGHT, pair.right.D, SIZE, R, T.reshape(3, 1), alpha=0
    )
    text = f"%YAML:1.0\n#-----\nCamera.fx: {P1[0, 0]}\nCamera.bf: 47.9\nLEFT.width: {SIZE[0]}\nLEFT.height: {SIZE[1]}\n"
    sides = (("LEFT", K_LEFT, pair.left.D, R1, P1), ("RIGHT", K_RIGHT, pair.right.D, R2, P2))
    for side, *matrices in sides:
        for name, matrix in zip(("K", "D", "R", "P"), matrices, strict=True):
            rows, cols = np.atleast_2d(matrix).shape
            text += f"{side}.{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n"
            text += f"   data:{np.ravel(matrix).tolist()}\n"
    (tmp_path / "EuRoC.yaml").write_text(text)
    found = read_calibration(tmp_path).calibration
    assert found.size == SIZE
    np.testing.assert_allclose(found.pictured().R, R, atol=1e-9)
    np.testing.assert_allclose(found.pictured().t, T, atol=1e-9)
    np.testing.assert_allclose(found.pictured().right.D, pair.right.D)


def test_kittis_baseline_in_millimetres(tmp_path: Path) -> None:
    (path,) = write_calibration(CASES["rectified"], "kitti", tmp_path / "calib.txt")
    P_right = RECTIFIED.projections()[1]
    path.write_text(path.read_text().replace(repr(float(P_right[0, 3])), repr(float(1000 * P_right[0, 3]))))
    found = read_calibration(path).calibration
    assert found.rectified is not None
    assert found.rectified.baseline_m == pytest.approx(RECTIFIED.baseline_m)
    assert any("taken as mm" in note for note in found.notes)
