"""The loops of `alignment`, compiled: one scan's edges against the pictures', and its surfaces."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stereocalib_core.numeric.arrays import Array

Lens = tuple[float, float, float, float, float, float]
"""Width, height, focal length, cx, cy [px], focal length times baseline [m px]."""

UNKNOWNS = 10
"""Height, pitch, roll, yaw, x, z of the LiDAR, then `EDGE`, `SWEEP`, `OFFSET`, `SCALE`."""
EDGE, SWEEP, OFFSET, SCALE = 6, 7, 8, 9
"""By how much the scan shows things narrower than the picture does, at each edge [px]; which way and how fast the
LiDAR turns while the car moves (+1: counter-clockwise, once a frame; 0: a scan of one moment); how much larger the
measured disparity is than the true one: a constant [px] and a share."""


@njit(cache=True, nogil=True)
def _place(
    point: Array, R: Array, t: Array, motion: Array, period: float, sweep: float, place: Array, pace: Array
) -> None:
    """A point of the LiDAR's frame in the camera frame of the shutter's moment (`place`), and how it changes with
    `sweep` (`pace`). motion: (6,) turn [rad/s] and speed [m/s] of the camera in its own axes."""
    x, y, z = point[0], point[1], point[2]
    for i in range(3):
        place[i] = R[i, 0] * x + R[i, 1] * y + R[i, 2] * z + t[i]
    time = period * math.atan2(y, x) / (2.0 * math.pi)
    pace[0] = time * (motion[3] + motion[1] * place[2] - motion[2] * place[1])
    pace[1] = time * (motion[4] + motion[2] * place[0] - motion[0] * place[2])
    pace[2] = time * (motion[5] + motion[0] * place[1] - motion[1] * place[0])
    for i in range(3):
        place[i] += sweep * pace[i]


@njit(cache=True, nogil=True)
def _moves(place: Array, t: Array, pace: Array, along: Array, J: Array) -> None:
    """J[:6] and J[SWEEP] of along . place; `along` (3,) is the derivative of what is measured by the place."""
    x, y, z = place[0] - t[0], place[1] - t[1], place[2] - t[2]
    J[0] = -along[1]
    J[1] = along[1] * z - along[2] * y
    J[2] = along[0] * y - along[1] * x
    J[3] = along[2] * x - along[0] * z
    J[4] = along[0]
    J[5] = along[2]
    J[SWEEP] = along[0] * pace[0] + along[1] * pace[1] + along[2] * pace[2]


@njit(cache=True, nogil=True)
def match_edges(
    beams: Array,
    edges: Array,
    lens: Lens,
    R: Array,
    t: Array,
    motion: Array,
    period: float,
    nuisance: Array,
    width: float,
    tolerance: tuple[float, float, float],
    half_contrast: float,
    background: float,
    H: Array,
    g: Array,
    curvature: Array,
    scores: Array,
    places: Array,
) -> tuple[float, float]:
    """Adds one scan's edges to the normal equations H (U, U), g (U,) of the next step and to the curvature (U, U) of
    their log likelihood; gives the latter over that of no match, and how many are matched.

    beams: (K, 4), edges: (M, 5) as `ScanSample` has them. Each beam edge is matched softly to all picture edges of its
    side, disparity and row: a Gauss curve of `width` [px] along the row, against a `background` of no match. tolerance:
    rows [px], disparity [px] and as a share. nuisance: (U - 6,). scores: (K, U) what each beam edge adds to g; places:
    (K, 3) where it is in the camera frame [m].
    """
    columns, rows, f, cx, cy, fb = lens
    place, pace, along = np.empty(3), np.empty(3), np.zeros(3)
    J = np.zeros(UNKNOWNS)
    gain, matched = 0.0, 0.0
    side, sweep = nuisance[0], nuisance[1]
    for k in range(len(beams)):
        scores[k] = 0.0
        _place(beams[k], R, t, motion, period, sweep, place, pace)
        places[k] = place
        if place[2] < 1.0:
            continue
        disparity = fb / place[2]
        u, v = f * place[0] / place[2] + cx + side * beams[k, 3], f * place[1] / place[2] + cy
        if not (0.0 <= u <= columns - 1.0 and 0.0 <= v <= rows - 1.0):
            continue
        measured = disparity * (1.0 + nuisance[3]) + nuisance[2]
        spread = tolerance[1] + tolerance[2] * disparity
        total, first, second = 0.0, 0.0, 0.0
        m = np.searchsorted(edges[:, 1], v - tolerance[0])
        while m < len(edges) and edges[m, 1] <= v + tolerance[0]:
            off, deeper = edges[m, 0] - u, edges[m, 2] - measured
            if edges[m, 3] == beams[k, 3] and abs(off) < 4.0 * width and abs(deeper) < 3.0 * spread:
                share = edges[m, 4] / (edges[m, 4] + half_contrast)
                share *= math.exp(-0.5 * ((off / width) ** 2 + (deeper / spread) ** 2))
                total += share
                first += share * off
                second += share * off * off
            m += 1
        if total == 0.0:
            continue
        gain += math.log1p(total / background)
        sure = total / (total + background)
        matched += sure
        along[0], along[2] = f / place[2], -f * place[0] / place[2] ** 2
        _moves(place, t, pace, along, J)
        J[EDGE] = beams[k, 3]
        weight = sure / width**2
        rest = first / total
        # how the matches change hands takes away from the curvature (Louis 1982)
        bend = weight - (sure * second / total - (sure * rest) ** 2) / width**4
        for i in range(UNKNOWNS):
            if J[i] == 0.0:
                continue
            scores[k, i] = weight * J[i] * rest
            g[i] += scores[k, i]
            for j in range(UNKNOWNS):
                H[i, j] += weight * J[i] * J[j]
                curvature[i, j] += bend * J[i] * J[j]
    return gain, matched


@njit(cache=True, nogil=True)
def match_surfaces(
    points: Array,
    patches: Array,
    lens: Lens,
    R: Array,
    t: Array,
    motion: Array,
    period: float,
    nuisance: Array,
    half_px: float,
    sigma: float,
    most: float,
    H: Array,
    g: Array,
    scores: Array,
    places: Array,
) -> None:
    """Adds one scan's surface points to the normal equations H (U, U), g (U,).

    points: (S, 3), patches: (P, 5) as `ScanSample` has them, squares of 2 `half_px`. sigma: of a patch's disparity
    [px], beyond which a point counts for less (Geman-McClure); `most`: not at all. scores: (S, U) what each point adds
    to g; places: (S, 3) where it is in the camera frame [m].
    """
    _, _, f, cx, cy, fb = lens
    place, pace, along = np.empty(3), np.empty(3), np.empty(3)
    J = np.zeros(UNKNOWNS)
    for k in range(len(points)):
        scores[k] = 0.0
        _place(points[k], R, t, motion, period, nuisance[1], place, pace)
        places[k] = place
        if place[2] < 1.0:
            continue
        u, v = f * place[0] / place[2] + cx, f * place[1] / place[2] + cy
        disparity = fb / place[2]
        m = np.searchsorted(patches[:, 1], v - half_px)
        while m < len(patches) and patches[m, 1] <= v + half_px:
            if abs(patches[m, 0] - u) <= half_px:
                break
            m += 1
        if m >= len(patches) or abs(patches[m, 1] - v) > half_px:
            continue
        patch = patches[m]
        measured = patch[2] + patch[3] * (u - patch[0]) + patch[4] * (v - patch[1])
        rest = measured - disparity * (1.0 + nuisance[3]) - nuisance[2]
        if abs(rest) > most:
            continue
        bent = 1.0 + (rest / (2.0 * sigma)) ** 2
        weight = 1.0 / (bent * sigma) ** 2
        across, down = f / place[2], f / place[2]
        along[0], along[1] = -patch[3] * across, -patch[4] * down
        along[2] = -(1.0 + nuisance[3]) * disparity / place[2]
        along[2] += (patch[3] * place[0] * f + patch[4] * place[1] * f) / place[2] ** 2
        _moves(place, t, pace, along, J)
        J[OFFSET], J[SCALE] = 1.0, disparity
        for i in range(UNKNOWNS):
            scores[k, i] = weight * J[i] * rest
            g[i] += scores[k, i]
            for j in range(UNKNOWNS):
                H[i, j] += weight * J[i] * J[j]
