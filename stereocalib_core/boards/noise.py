"""What single pictures and clouds say of their own noise, and the joint problem that is weighed by it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stereocalib_core.boards.camera import BoardCamera
from stereocalib_core.boards.centres import Centres
from stereocalib_core.boards.joint import NO_PLANE_SIGMA, JointProblem, Noise
from stereocalib_core.boards.observation import BoardSpec, PairObservation
from stereocalib_core.config.boards import PLANE, REFINE
from stereocalib_core.numeric.arrays import Array


def estimate_noise(observations: Sequence[PairObservation], kappa: float | None = None) -> Noise:
    """The sensors' sigmas from how well single pictures and single clouds fit their own board (medians).

    `kappa` [px/m] replaces the ratio of the two; the corners' sigma stays and the range's follows.
    """
    corner = corner_sigmas(observations)
    spans = []
    for o in observations:
        if o.lidar_plane is not None and len(o.points_lidar):
            rays = o.points_lidar / np.linalg.norm(o.points_lidar, axis=1, keepdims=True)
            slant = np.maximum(np.abs(rays @ o.lidar_plane.plane.normal), PLANE.slant_floor)
            spans.append(
                float(np.sqrt(np.mean((o.lidar_plane.plane.signed_distance(o.points_lidar) / slant) ** 2)))
            )
    corner_px = max(float(np.median(corner)) if len(corner) else 0.0, REFINE.least_corner_sigma_px)
    range_m = max(float(np.median(spans)) if spans else 0.0, REFINE.least_range_sigma_m)
    return Noise(corner_px, range_m if kappa is None else corner_px / kappa)


def corner_sigmas(observations: Sequence[PairObservation]) -> Array:
    """(M,) px, one coordinate of a corner in each picture that shows a board, from how its own board fits it."""
    seen = [(o.corner_rms_px, len(o.corners)) for o in observations if o.corners is not None]
    return np.array([rms * np.sqrt(count / (2 * count - 6)) for rms, count in seen])


def joint_problem(
    kept: Sequence[PairObservation],
    board: BoardSpec,
    camera: BoardCamera,
    noise: Noise,
    plane_sigma: tuple[float, float] = NO_PLANE_SIGMA,
    centres: Centres | None = None,
) -> JointProblem:
    """The measurements of these pairs for `refine`; very dense boards are thinned evenly.

    Pictures differ: a blurred or a far board's corners count for less, by how much worse its own pose fits them.
    """
    clouds = [_thinned(o.points_lidar) for o in kept]
    corners = [o.corners for o in kept if o.corners is not None]
    counts = np.array([len(c) for c in clouds], dtype=np.int64)
    own = np.maximum(corner_sigmas(kept), REFINE.least_corner_sigma_px)
    return JointProblem(
        camera,
        np.array(corners),
        noise.corner_px * own / np.median(own),
        board.corners_board,
        np.concatenate(clouds),
        counts,
        noise,
        plane_sigma,
        centres,
    )


def _thinned(points: Array) -> Array:
    if len(points) <= REFINE.most_points:
        return points
    return points[np.sort(np.random.default_rng(0).choice(len(points), REFINE.most_points, replace=False))]
