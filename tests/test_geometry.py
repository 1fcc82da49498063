"""Every forward/inverse pair of the projection, and the equations against each other."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereocalib_core import geometry as g
from stereocalib_core.errors import ConfigError

CAMERA = g.StereoCamera(1226, 370, 707.0912, 601.8873, 183.1104, 0.53715)
ANGLE = st.floats(-10.0, 10.0)
HEIGHT = st.floats(0.5, 3.0)
EXTRINSICS = st.builds(g.Extrinsics.from_degrees, HEIGHT, ANGLE, ANGLE, ANGLE)
U = st.floats(0.0, 1225.0)
V = st.floats(0.0, 369.0)
DISPARITY = st.floats(1.0, 120.0)
XYZ = st.tuples(st.floats(-10, 10), st.floats(-2, 1), st.floats(4, 60))

close = pytest.approx


def eq_5(e: g.Extrinsics, x: float, y: float, z: float) -> float:
    """Disparity of a point in the road frame, as the paper writes it."""
    s, c = np.sin(e.pitch_rad), np.cos(e.pitch_rad)
    depth = z * c + (y + e.height_m) * np.cos(e.roll_rad) * s + x * np.sin(e.roll_rad) * s
    return float(CAMERA.focal_px * CAMERA.baseline_m / depth)


def eq_8(e: g.Extrinsics, u: float, disparity: float) -> float:
    """Row in which the road shows a disparity in column u, as the paper writes it."""
    v = np.tan(e.roll_rad) / np.cos(e.pitch_rad) * (u - CAMERA.cx_px)
    v -= CAMERA.focal_px * np.tan(e.pitch_rad)
    v += e.height_m * disparity / (CAMERA.baseline_m * np.cos(e.roll_rad) * np.cos(e.pitch_rad))
    return float(CAMERA.cy_px + v)


@given(EXTRINSICS)
def test_disparity_plane_and_extrinsics(e: g.Extrinsics) -> None:
    back = e.disparity_plane(CAMERA).extrinsics(CAMERA, e.yaw_rad)
    assert (back.height_m, back.pitch_rad, back.roll_rad) == close(
        (e.height_m, e.pitch_rad, e.roll_rad), abs=1e-9
    )


@given(EXTRINSICS)
def test_plane_and_extrinsics(e: g.Extrinsics) -> None:
    back = g.Extrinsics.from_plane(e.plane(), e.yaw_rad)
    assert (back.height_m, back.pitch_rad, back.roll_rad) == close(
        (e.height_m, e.pitch_rad, e.roll_rad), abs=1e-9
    )


@given(HEIGHT, ANGLE, ANGLE)
def test_profile_and_extrinsics(h: float, pitch: float, roll: float) -> None:
    e = g.Extrinsics.from_degrees(h, pitch, roll)
    back = g.extrinsics_from_profile(CAMERA, *g.road_profile(CAMERA, e), e.roll_rad)
    assert (back.height_m, back.pitch_rad) == close((e.height_m, e.pitch_rad), abs=1e-9)


@given(ANGLE, ANGLE)
def test_roll_and_slope(pitch_deg: float, roll_deg: float) -> None:
    pitch, roll = np.deg2rad([pitch_deg, roll_deg])
    assert g.roll_from_slope(g.slope_from_roll(roll, pitch), pitch) == close(roll, abs=1e-12)


@given(EXTRINSICS, XYZ)
def test_road_and_image(e: g.Extrinsics, xyz: tuple[float, float, float]) -> None:
    uvd = g.road_to_image(CAMERA, e, xyz)
    assert g.image_to_road(CAMERA, e, *uvd) == close(np.array(xyz), abs=1e-9)


@given(EXTRINSICS, XYZ)
def test_eq_5_is_the_disparity_of_eq_3(e: g.Extrinsics, xyz: tuple[float, float, float]) -> None:
    assert g.road_to_image(CAMERA, e, xyz)[2] == close(eq_5(e, *xyz), rel=1e-12)


@given(EXTRINSICS, U, DISPARITY)
def test_eq_8_and_eq_16_describe_one_plane(e: g.Extrinsics, u: float, d: float) -> None:
    v = eq_8(e, u, d)
    assert e.disparity_plane(CAMERA).disparity(CAMERA, u, v) == close(d, abs=1e-9)


@given(EXTRINSICS, U, DISPARITY)
def test_points_of_the_plane_have_height_zero(e: g.Extrinsics, u: float, d: float) -> None:
    v = eq_8(e, u, d)
    assert g.image_to_road(CAMERA, e, u, v, d)[1] == close(0.0, abs=1e-9)
    on_plane = CAMERA.back_project(u, v, d)
    assert e.plane().signed_distance(on_plane) == close(0.0, abs=1e-9 * max(1.0, 400.0 / d))


@given(EXTRINSICS, U, V)
def test_image_to_road_plane_and_back(e: g.Extrinsics, u: float, v: float) -> None:
    disparity = e.disparity_plane(CAMERA).disparity(CAMERA, u, v)
    x, z = g.image_to_road_plane(CAMERA, e, u, v)
    if disparity <= 0.5:
        assert disparity > 0 or np.isnan(x)
        return
    assert g.road_to_image(CAMERA, e, [x, 0.0, z])[:2] == close(np.array([u, v]), abs=1e-7)


@given(EXTRINSICS)
def test_eq_15_is_the_vehicle_frame(e: g.Extrinsics) -> None:
    x, z = 1.0, 10.0
    c, s = np.cos(e.yaw_rad), np.sin(e.yaw_rad)
    by_matrix = g.invert_transform(e.T_road_vehicle)[:3, :3] @ [x, 0.0, z]
    assert by_matrix == close(np.array([c * x - s * z, 0.0, s * x + c * z]), abs=1e-12)


@given(EXTRINSICS)
def test_vanishing_point_gives_yaw_under_pitch_and_roll(e: g.Extrinsics) -> None:
    u, v = g.vanishing_point_of_travel(CAMERA, e)
    assert g.yaw_from_vanishing_point(CAMERA, u, v, e) == close(e.yaw_rad, abs=1e-9)


@given(EXTRINSICS, U)
def test_horizon_is_where_the_road_has_no_disparity(e: g.Extrinsics, u: float) -> None:
    slope, row = g.horizon(CAMERA, e)
    v = row + slope * (u - CAMERA.cx_px)
    assert e.disparity_plane(CAMERA).disparity(CAMERA, u, v) == close(0.0, abs=1e-8)


@given(EXTRINSICS)
def test_transforms_invert(e: g.Extrinsics) -> None:
    assert e.T_camera_vehicle @ e.T_vehicle_camera == close(np.eye(4), abs=1e-12)
    plane = g.Plane(np.array([0.0, 1.0, 0.0]), 0.0).transformed(e.T_camera_road)
    assert (*plane.normal, plane.offset_m) == close((*e.plane().normal, e.height_m), abs=1e-12)


@given(HEIGHT, ANGLE, ANGLE)
def test_jacobian_of_the_disparity_plane(h: float, pitch: float, roll: float) -> None:
    e = g.Extrinsics.from_degrees(h, pitch, roll)
    step = 1e-6
    columns = []
    for k in range(3):
        values = np.array([e.height_m, e.pitch_rad, e.roll_rad])
        ends = []
        for sign in (1, -1):
            moved = g.Extrinsics(*(values + sign * step * np.eye(3)[k])).disparity_plane(CAMERA)
            ends.append(np.array([moved.a, moved.b, moved.c_px]))
        columns.append((ends[0] - ends[1]) / (2 * step))
    expected = np.array(columns).T
    assert e.disparity_plane_jacobian(CAMERA) == close(expected, rel=1e-5, abs=1e-6)


def test_signs() -> None:
    down = g.Extrinsics.from_degrees(1.65, 2.0, 0.0)
    assert g.horizon(CAMERA, down)[1] < CAMERA.cy_px, "looking down moves the horizon up"
    rolled = g.Extrinsics.from_degrees(1.65, 0.0, 2.0)
    assert g.horizon(CAMERA, rolled)[0] > 0, "positive roll lets the horizon fall to the right"
    left = g.Extrinsics.from_degrees(1.65, 0.0, 0.0, 1.0)
    assert g.vanishing_point_of_travel(CAMERA, left)[0] > CAMERA.cx_px, "the camera looks left of travel"


def test_disparity_offset_is_that_of_infinity() -> None:
    camera = g.StereoCamera(640, 480, 500.0, 320.0, 240.0, 0.2, cx_right_px=310.0)
    assert camera.disparity_offset_px == 10.0
    assert CAMERA.disparity_offset_px == 0.0


@pytest.mark.parametrize("broken", [(0, 370, 700, 600, 180, 0.5), (1226, 370, float("nan"), 600, 180, 0.5),
                                    (1226, 370, 700, 600, 180, 0.0)])  # fmt: skip
def test_a_camera_that_is_none_is_refused(broken: tuple[float, ...]) -> None:
    with pytest.raises(ConfigError, match="camera"):
        g.StereoCamera(*broken)  # type: ignore[arg-type]
