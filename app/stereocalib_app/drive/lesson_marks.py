"""What a lesson draws on the left image: the lines, tracks, points and ellipses that it speaks of. Pure functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from stereocalib_app.widgets import canvas, palette
from stereocalib_app.widgets.canvas import Picture
from stereocalib_core.geometry import (
    Extrinsics,
    StereoCamera,
    image_to_road_plane,
    slope_from_roll,
    vanishing_point_of_travel,
)
from stereocalib_core.results import FrameResult

Array = NDArray[np.float64]
MOST_TRACKS = 160
INSET_PX: Final = (300, 190)


def fixed_disparity_lines(picture: Picture, camera: StereoCamera, road: Extrinsics) -> None:
    """Road points of one disparity lie on a line v = C u + d, whose slope is the roll (eq. 12). In place."""
    slope = slope_from_roll(road.roll_rad, road.pitch_rad)
    plane = road.disparity_plane(camera)
    at = plane.disparity(camera, camera.cx_px, np.arange(camera.height, dtype=np.float64))
    for row in (0.62, 0.78, 0.92):
        v = row * camera.height
        u = np.array([0.15 * camera.width, 0.85 * camera.width])
        ends = np.stack([u, v + slope * (u - camera.cx_px)], axis=1)
        canvas.polyline(picture, ends, palette.SMOOTHED, 3)
        words = f"Δ = {at[min(int(v), camera.height - 1)]:.0f} px"
        canvas.put_label(picture, words, int(ends[1, 0]) + 6, int(ends[1, 1]) - 12, palette.SMOOTHED)


def tracks(
    picture: Picture, result: FrameResult | None, camera: StereoCamera, road: Extrinsics | None
) -> None:
    """Points of the frame before to where they are now: green on the road, grey above it; those on the road are
    drawn on to where they meet when the car drives straight. In place."""
    if result is None or result.tracks is None:
        canvas.put_label(picture, "no tracks yet: step on one frame", 8, 8)
        return
    points, on_road = result.tracks.points.astype(np.float64), result.tracks.on_road
    every = max(1, len(points) // MOST_TRACKS)
    for point, ours in zip(points[::every], on_road[::every], strict=True):
        color = palette.ROAD if ours else palette.INK_SOFT
        canvas.polyline(picture, np.array([point[:2], point[3:5]]), color, 2)
        cv2.circle(picture, (int(point[3]), int(point[4])), 3, color, -1, cv2.LINE_AA)
    if road is None:
        return
    u, v = vanishing_point_of_travel(camera, road)
    for point in points[on_road][:: max(1, int(on_road.sum()) // 12)]:
        canvas.dashed(picture, point[3:5], (u, v), palette.HORIZON, 1)
    cv2.drawMarker(picture, (int(u), int(v)), palette.HORIZON, cv2.MARKER_CROSS, 40, 3, cv2.LINE_AA)
    canvas.put_label(picture, f"vanishing point, yaw {road.yaw_deg:.2f}°", int(u) + 14, int(v) - 34)


def sigma_points(mean: Array, covariance: Array) -> Array:
    """(7, 3) the points of the unscented transform of three states with alpha 1, kappa 0."""
    root = np.linalg.cholesky(3.0 * covariance + 1e-18 * np.eye(3))
    return np.concatenate([mean[None], mean + root.T, mean - root.T])


def plane_of(camera: StereoCamera, state: Array) -> Array:
    """(2,) slope A and offset C of the disparity plane of height [m], pitch, roll [rad]."""
    plane = Extrinsics(*(float(v) for v in state)).disparity_plane(camera)
    return np.array([plane.disparity(camera, camera.cx_px, camera.cy_px + 1.0), 0.0]) + np.array(
        [-1.0, 1.0]
    ) * float(plane.disparity(camera, camera.cx_px, camera.cy_px))


def filter_inset(
    picture: Picture,
    camera: StereoCamera,
    result: FrameResult | None,
    filtered: tuple[Extrinsics, Array] | None,
    live: Extrinsics | None,
) -> None:
    """The measurement's ellipse in the disparity plane's A and C, and the filter's sigma points over it. In place."""
    width, height = INSET_PX
    x0, y0 = picture.shape[1] - width - 8, 8
    picture[y0 : y0 + height, x0 : x0 + width] //= 4
    if result is None or result.road is None or filtered is None:
        canvas.put_label(picture, "no measurement: only predicted", x0 + 8, y0 + 8, palette.FAILED)
        return
    e = result.road.extrinsics
    centre = np.array([e.height_m, e.pitch_rad, e.roll_rad])
    measured = sigma_points(centre, result.road.covariance + result.road.bend_covariance)
    f, sigma = filtered
    known = sigma_points(np.array([f.height_m, f.pitch_rad, f.roll_rad]), np.diag(sigma**2))
    clouds = [np.array([plane_of(camera, state) for state in cloud]) for cloud in (measured, known)]
    spread = np.maximum(np.std(np.concatenate(clouds), axis=0), 1e-12)
    middle = np.concatenate(clouds).mean(axis=0)

    def place(points: Array) -> Array:
        scaled = (points - middle) / (4.0 * spread)
        return np.array([x0 + width / 2, y0 + height / 2]) + scaled * np.array([width, -height])

    shape = np.cov(clouds[0].T)
    values, vectors = np.linalg.eigh(shape)
    turn = np.linspace(0, 2 * np.pi, 60)
    circle = np.stack([np.cos(turn), np.sin(turn)]) * np.sqrt(np.maximum(values, 0))[:, None]
    canvas.polyline(picture, place(clouds[0].mean(axis=0) + (vectors @ circle).T), palette.RAW, 2)
    for x, y in place(clouds[1]):
        cv2.circle(picture, (int(x), int(y)), 4, palette.FILTERED, -1, cv2.LINE_AA)
    if live is not None:
        used = plane_of(camera, np.array([live.height_m, live.pitch_rad, live.roll_rad]))
        x, y = place(used[None])[0]
        cv2.drawMarker(picture, (int(x), int(y)), palette.LIVE, cv2.MARKER_CROSS, 26, 3, cv2.LINE_AA)
    canvas.put_text(picture, "A, C: this pair (ellipse)", x0 + 8, y0 + 4, palette.RAW, 16)
    canvas.put_text(picture, "filter's sigma points", x0 + 8, y0 + height - 24, palette.FILTERED, 16)


def path_around(poses: Array, frame: int) -> Array | None:
    """(N, 2) x to the right and z ahead [m] of the path from PAST frames before to AHEAD after, as the camera of
    `frame` sees them; None where that frame has no pose. poses: (M, 4, 4)."""
    if frame >= len(poses) or not np.isfinite(poses[frame]).all():
        return None
    near = poses[max(0, frame - PAST) : frame + AHEAD + 1, :3, 3]
    here = poses[frame]
    return np.asarray(((near - here[:3, 3]) @ here[:3, :3])[:, [0, 2]])


PAST, AHEAD = 40, 15
METRES_WIDE, METRES_DEEP, METRES_BACK = 24.0, 30.0, 12.0
"""What the map from above shows: across, ahead, and behind the car."""


def path_inset(
    picture: Picture,
    camera: StereoCamera,
    result: FrameResult | None,
    road: Extrinsics | None,
    path: Array | None,
) -> None:
    """From above: where eq. 16 puts the tracked road points in the frame before (end of the line) and now (dot),
    and the path that such motions add up to. In place."""
    width, height = INSET_PX[0], min(INSET_PX[1] + 60, picture.shape[0] - 16)
    x0, y0 = picture.shape[1] - width - 8, 8
    picture[y0 : y0 + height, x0 : x0 + width] //= 4
    scale = min(width / METRES_WIDE, (height - 26) / (METRES_DEEP + METRES_BACK))
    middle = np.array([x0 + width / 2, y0 + height - METRES_BACK * scale])

    def place(points: Array) -> Array:
        placed = middle + points * np.array([scale, -scale])
        outside = (
            (placed[:, 0] < x0)
            | (placed[:, 0] >= x0 + width)
            | (placed[:, 1] < y0 + 26)
            | (placed[:, 1] >= y0 + height)
        )
        return np.where(outside[:, None], np.nan, placed)

    if path is not None:
        canvas.polyline(picture, place(path), palette.VARIANT["autocalibrated"], 2)
    if result is not None and result.tracks is not None and road is not None:
        points = result.tracks.points[result.tracks.on_road].astype(np.float64)
        points = points[:: max(1, len(points) // MOST_TRACKS)]
        before, now = (
            place(image_to_road_plane(camera, road, points[:, k], points[:, k + 1])) for k in (0, 3)
        )
        for a, b in zip(before, now, strict=True):
            canvas.polyline(picture, np.array([a, b]), palette.ROAD, 1)
            if np.isfinite(b).all():
                cv2.circle(picture, (int(b[0]), int(b[1])), 2, palette.HORIZON, -1, cv2.LINE_AA)
    cv2.drawMarker(picture, (int(middle[0]), int(middle[1])), palette.INK, cv2.MARKER_TRIANGLE_UP, 12, 2)
    x = canvas.put_text(picture, "eq. 16 from above: ", x0 + 8, y0 + 4, palette.INK, 15)
    x = canvas.put_text(picture, "points, ", x, y0 + 4, palette.HORIZON, 15)
    canvas.put_text(picture, "path", x, y0 + 4, palette.VARIANT["autocalibrated"], 15)


Draw = Callable[[Picture], None]


def marks(
    lesson: str,
    camera: StereoCamera,
    result: FrameResult | None,
    road: Extrinsics | None,
    filtered: tuple[Extrinsics, Array] | None,
    live: Extrinsics | None,
    path: Array | None = None,
) -> Draw | None:
    """What a lesson draws, None where it draws nothing of its own."""
    if lesson == "Roll" and (live or road) is not None:
        used = live or road
        assert used is not None
        return lambda picture: fixed_disparity_lines(picture, camera, used)
    if lesson == "Yaw":
        return lambda picture: tracks(picture, result, camera, live or road)
    if lesson == "Odometry":

        def draw(picture: Picture) -> None:
            tracks(picture, result, camera, live or road)
            path_inset(picture, camera, result, live or road, path)

        return draw
    if lesson == "Filter":
        return lambda picture: filter_inset(picture, camera, result, filtered, live)
    return None
