"""Points of the road, and above it, followed from one stereo pair to the next.

Corners that lie on the measured road are looked for where the road plane and the predicted motion say (the
patch is warped by the plane's homography, whose local part is `affine`), points above it where their own
depth says. A point is kept when it comes back (forward and backward), when its left-right match is found in
both frames, and when it moves with the world: what the pair's own robust motion does not explain in row,
column and disparity (cars, shadows, reflections) is dropped. No correction setting enters anywhere.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.config import OdometryConfig, TracksConfig
from stereocalib_core.front.tracks.bent_pair import Judge, judge_by
from stereocalib_core.front.tracks.corners import Corners, Sharpness, find_corners, slopes
from stereocalib_core.front.tracks.pair_motion import reprojection, robust_motion
from stereocalib_core.front.tracks.patches import follow
from stereocalib_core.front.tracks.row_patches import match_rows, row_leans
from stereocalib_core.front.tracks.search import search_motion
from stereocalib_core.geometry import Extrinsics, StereoCamera
from stereocalib_core.numeric.arrays import Array
from stereocalib_core.numeric.small_algebra import rotation_from_vector
from stereocalib_core.results import DisparityMap, Tracks

Image = NDArray[np.uint8]

_ITERATIONS = OdometryConfig().solver.iterations
"""The tracker's own motion is solved as the odometry's is, but no setting of that enters here."""


@dataclass(frozen=True)
class PairView:
    """What the tracker sees of one stereo pair.

    left, right: (H, W) uint8. disparity: the pair's own. extrinsics: the pair's own road, or where it shows
    none (`road_known` False) the last known or nominal one. sharpness: of the left picture, where it is made already.
    """

    index: int
    left: Image
    right: Image
    disparity: DisparityMap
    extrinsics: Extrinsics
    road_known: bool = True
    sharpness: Sharpness | None = field(default=None, repr=False)


@dataclass(frozen=True)
class TrackerState:
    """The last usable pair, its pyramid (full, half, quarter size), its corners, and how it was reached.

    motion: (6,) rotation vector [rad], translation [m] of T_current_previous per frame; None = not known.
    """

    view: PairView | None = None
    pyramid: tuple[Image, Image, Image] | None = field(default=None, repr=False)
    corners: Corners | None = field(default=None, repr=False)
    motion: Array | None = None


def advance(
    camera: StereoCamera,
    state: TrackerState,
    view: PairView,
    config: TracksConfig | None = None,
    aside: Executor | None = None,
) -> tuple[TrackerState, Tracks | None]:
    """The next usable pair: the new state, and the tracks from the pair before, if there are any.

    aside: finds the corners to go on from meanwhile.
    """
    config = config or TracksConfig()
    sharpness = view.sharpness or Sharpness.of(view.left)
    pyramid, strength = sharpness.pyramid, sharpness.strength
    here = camera, view.left, view.right, strength, view.extrinsics, view.disparity, view.road_known, config
    finding = None if aside is None else aside.submit(find_corners, *here)
    tracks: Tracks | None = None
    motion: Array | None = None
    if state.view is not None and state.pyramid is not None and state.corners is not None:
        jump = view.index - state.view.index
        if 0 < jump <= config.max_jump + 1:
            tracks, found = _track(camera, state, view, pyramid, jump, config)
            motion = None if found is None else found / jump
    corners = find_corners(*here) if finding is None else finding.result()
    return TrackerState(replace(view, sharpness=None), pyramid, corners, motion), tracks


def _track(
    camera: StereoCamera,
    state: TrackerState,
    view: PairView,
    pyramid: tuple[Image, Image, Image],
    jump: int,
    config: TracksConfig,
) -> tuple[Tracks | None, Array | None]:
    """Tracks between the state's pair and `view`, and the motion between them."""
    assert state.view is not None and state.pyramid is not None and state.corners is not None
    corners = state.corners
    if len(corners.points) < config.min_points:
        return None, None
    f, fb = camera.focal_px, camera.focal_px * camera.baseline_m
    rays = np.empty((5, len(corners.points)))
    rays[0] = (corners.points[:, 0] - camera.cx_px) / f
    rays[1] = (corners.points[:, 1] - camera.cy_px) / f
    rays[2] = corners.disparity / fb
    predicted: Array | None = None if state.motion is None else state.motion * jump
    ok, agreement = np.zeros(len(corners.points), dtype=bool), 0.0
    motion: Array | None = None
    judge: Judge | None = None
    if predicted is not None:
        ok, motion, judge, agreement = _follow(camera, state, pyramid, rays, predicted, 1, config)
    for wide in (False, True):
        if agreement >= config.min_agreement or (wide and not (state.view.road_known and view.road_known)):
            break
        start = search_motion(
            state.pyramid[2],
            pyramid[2],
            rays,
            corners.on_road,
            camera,
            state.motion,
            jump,
            config.search,
            wide,
        )
        retry = rays.copy()
        ok_2, motion_2, judge_2, agreement_2 = _follow(camera, state, pyramid, retry, start, 2, config)
        if agreement_2 > agreement:
            ok, motion, judge, agreement, rays = ok_2, motion_2, judge_2, agreement_2, retry
    if motion is None or judge is None or np.count_nonzero(ok) < config.min_points:
        return None, None
    return _finish(camera, state, view, rays, ok, judge, config), motion


def _follow(
    camera: StereoCamera,
    state: TrackerState,
    pyramid: tuple[Image, Image, Image],
    rays: Array,
    predicted: Array,
    coarsest: int,
    config: TracksConfig,
) -> tuple[NDArray[np.bool_], Array | None, Judge | None, float]:
    """Track all corners from a predicted motion; fills rays[3:5].

    Returns which points move together, their motion, by whom they were judged, and which share of all corners in
    sight they are.
    """
    assert state.view is not None and state.pyramid is not None and state.corners is not None
    corners, f = state.corners, camera.focal_px
    seen = reprojection(rays, predicted)
    where = np.column_stack([seen[0] * f + camera.cx_px, seen[1] * f + camera.cy_px])
    affine = patch_affine(rays, predicted, seen, corners.on_road, state.view.extrinsics)
    found, ok = follow(
        state.pyramid, pyramid, corners.points, where, affine, coarsest,
        config.patch.min_correlation, config.patch.max_return_px, config.patch.min_contrast,
    )  # fmt: skip
    border = config.border_px
    inside = (where[:, 0] > border) & (where[:, 0] < camera.width - 1 - border)
    inside &= (where[:, 1] > border) & (where[:, 1] < camera.height - 1 - border)
    rays[3] = (found[:, 0] - camera.cx_px) / f
    rays[4] = (found[:, 1] - camera.cy_px) / f
    if np.count_nonzero(ok) < config.min_points:
        return ok, None, None, 0.0
    votes = np.where(corners.on_road[ok], config.road_votes, 1.0)
    motion, _ = robust_motion(
        np.ascontiguousarray(rays[:, ok]),
        votes,
        predicted,
        f,
        config.tolerance_px,
        config.samples,
        _ITERATIONS,
    )
    followed = float(ok.sum())
    judge = judge_by(camera, np.ascontiguousarray(rays[:, ok]), motion, config.tolerance_px, config.bent)
    seen = judge.expected(rays)
    ok = ok & (np.hypot(seen[0] - rays[3], seen[1] - rays[4]) * f < config.tolerance_px)
    if ok.sum() < config.min_consent * followed:
        return ok, None, None, 0.0
    return ok, motion, judge, float(ok.sum()) / max(float(inside.sum()), float(config.min_points))


def patch_affine(
    rays: Array, motion: Array, seen: Array, on_road: NDArray[np.bool_], extrinsics: Extrinsics
) -> Array:
    """(N, 4) d(u', v') / d(u, v) of each point's surface: the road plane, or one that faces the camera."""
    R = rotation_from_vector(motion[:3])
    normal = np.where(on_road, 1.0, 0.0) * (extrinsics.plane().normal / extrinsics.height_m)[:, None]
    depth = rays[2] / seen[2]
    # d(q) / d(x, y) with q = R (x, y, 1) + t w; on the road the inverse depth w changes by n / h
    du = R[:, :1] + motion[3:, None] * normal[0]
    dv = R[:, 1:2] + motion[3:, None] * normal[1]
    rows = [
        (du[0] - seen[0] * du[2]) / depth,
        (dv[0] - seen[0] * dv[2]) / depth,
        (du[1] - seen[1] * du[2]) / depth,
        (dv[1] - seen[1] * dv[2]) / depth,
    ]
    return np.ascontiguousarray(np.stack(rows, axis=1))


def _finish(
    camera: StereoCamera,
    state: TrackerState,
    view: PairView,
    rays: Array,
    ok: NDArray[np.bool_],
    judge: Judge,
    config: TracksConfig,
) -> Tracks:
    """Left-right matches in the current frame, and the check that disparities change with the motion too."""
    assert state.view is not None and state.corners is not None
    corners, f, fb = state.corners, camera.focal_px, camera.focal_px * camera.baseline_m
    pick = np.flatnonzero(ok)
    on_road = corners.on_road[pick]
    points = np.column_stack([rays[3, pick] * f + camera.cx_px, rays[4, pick] * f + camera.cy_px])
    expected = judge.expected(np.ascontiguousarray(rays[:, pick]))[2] * fb
    plane = view.extrinsics.disparity_plane(camera)
    offset = camera.disparity_offset_px
    tilt = slopes(plane.a, plane.b, on_road)
    patch = config.patch
    matched = match_rows(
        view.left, view.right, points, expected + offset, tilt, np.zeros(len(points)),
        patch.min_correlation, config.reach_px, patch.min_contrast,
    )  # fmt: skip
    disparity = matched - offset
    good = np.abs(disparity - expected) < config.disparity_tolerance_px
    before = state.view
    rows = np.column_stack([corners.points[pick], corners.disparity[pick], points, disparity])[good]
    lean = np.zeros((len(rows), 2), np.float32)
    for k, pair, own in ((0, before, before.extrinsics.disparity_plane(camera)), (1, view, plane)):
        where, raw = rows[:, 3 * k : 3 * k + 2].copy(), rows[:, 3 * k + 2] + offset
        tilts = slopes(own.a, own.b, on_road[good])
        lean[:, k] = row_leans(pair.left, pair.right, where, raw, tilts, np.zeros(len(rows)))
    return Tracks(rows.astype(np.float32), on_road[good], before.index, lean)
