"""What a set of boards can show, and which board to add where it cannot.

The singular values of the stacked unit normals (over sqrt M) tell it: with one direction only, the turn
about it stays open (and so does the way along the boards); with two, the way across both; three
independent ones fix everything.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from stereocalib_core.config.boards import OBSERVABILITY
from stereocalib_core.numeric.arrays import Array

EDGE_ON = "edge-on"
AXES = ("x (right)", "y (down)", "z (forward)")


@dataclass(frozen=True)
class Observability:
    """singular_values: (3,) of the normals over sqrt M, largest first; verdict; why, in one sentence or two.

    missing: (3,) unit direction in the camera frame that is least seen, or None when all is well.
    """

    singular_values: Array
    verdict: Literal["good", "weak", "degenerate"]
    why: str
    missing: Array | None = None


def observability(
    normals_camera: Array, covariance: Array, edge_on: tuple[str, ...] = (), left_open: bool = True
) -> Observability:
    """(M, 3) board normals in the camera frame and the (6, 6) covariance of (rotation, translation) to a verdict.

    left_open: whether normals that are nearly parallel, or nearly in one plane, are so beyond what sigma could say of
    them. `edge_on` are the names of boards that were left out because their plane passes through a sensor's origin.
    """
    count = len(normals_camera)
    stacked = np.vstack([normals_camera, np.zeros((3, 3))])
    _, values, directions = np.linalg.svd(stacked / np.sqrt(max(count, 1)))
    through = _edge_on_words(edge_on) if count < 3 or values[2] < OBSERVABILITY.degenerate else ""
    if count == 0:
        return Observability(
            values,
            "degenerate",
            f"no board can be used: nothing is observable. {through}".strip(),
            np.array([0.0, 0.0, 1.0]),
        )
    mean = normals_camera.mean(axis=0)
    missing = directions[2] * (1.0 if directions[2][np.argmax(np.abs(directions[2]))] > 0 else -1.0)
    advice = _advice(directions[0] * np.sign(directions[0] @ mean or 1.0), missing)
    if count < 2 or (left_open and values[1] < OBSERVABILITY.degenerate):
        spread = np.rad2deg(values[1])
        why = (
            f"all {count} boards are parallel within {spread:.1f} deg: the turn about their normal, "
            f"{name_direction(directions[0])}, and the shift along them, {name_direction(directions[1])} and "
            f"{name_direction(missing)}, cannot be observed"
        )
        return Observability(values, "degenerate", f"{why}; {advice}. {through}".strip(), missing)
    if count < 3 or (left_open and values[2] < OBSERVABILITY.degenerate):
        why = (
            f"the normals of the {count} boards lie in one plane: the shift along {name_direction(missing)} "
            "cannot be observed"
        )
        return Observability(values, "degenerate", f"{why}; {advice}. {through}".strip(), missing)
    return _by_sigma(values, covariance, missing, advice, count)


def leave_open(normals: Array) -> bool:
    """Whether planes with these (M, 3) normals alone leave some direction open."""
    values = np.linalg.svd(np.vstack([normals, np.zeros((3, 3))]), compute_uv=False)
    return bool(len(normals) < 3 or values[2] < OBSERVABILITY.degenerate * np.sqrt(len(normals)))


def _by_sigma(values: Array, covariance: Array, missing: Array, advice: str, count: int) -> Observability:
    turn, turn_axis = _worst(covariance[:3, :3])
    shift, shift_axis = _worst(covariance[3:, 3:])
    numbers = f"sigma {1000 * shift:.1f} mm along {name_direction(shift_axis)}, {np.rad2deg(turn):.2f} deg"
    if too_uncertain(covariance):
        return Observability(
            values, "degenerate", f"too uncertain to be used: {numbers}; {advice}.", shift_axis
        )
    if shift > OBSERVABILITY.poor_m or turn > OBSERVABILITY.poor_rad or values[2] < OBSERVABILITY.degenerate:
        return Observability(
            values, "weak", f"{name_direction(missing)} is hardly seen: {numbers}; {advice}.", missing
        )
    if count == 3:
        return Observability(
            values, "weak", f"three boards leave nothing to check them with: {numbers}; add a few.", None
        )
    return Observability(values, "good", f"{count} boards see every direction: {numbers}.", None)


def too_uncertain(covariance: Array) -> bool:
    """(6, 6) of (rotation, translation): whether some direction is as good as not seen."""
    shift, turn = _worst(covariance[3:, 3:])[0], _worst(covariance[:3, :3])[0]
    return shift > OBSERVABILITY.lost_m or turn > OBSERVABILITY.lost_rad


def _worst(covariance: Array) -> tuple[float, Array]:
    values, vectors = np.linalg.eigh(covariance)
    return float(np.sqrt(max(values[-1], 0.0))), vectors[:, -1]


def name_direction(direction: Array) -> str:
    """A unit vector in the camera frame in words: the axis when it is close to one, else its numbers too."""
    axis = int(np.argmax(np.abs(direction)))
    if abs(direction[axis]) > OBSERVABILITY.named_axis:
        return f"camera {AXES[axis]}"
    x, y, z = direction * np.sign(direction[axis])
    return f"camera ({x:.2f}, {y:.2f}, {z:.2f}), nearest {AXES[axis]}"


def _advice(usual: Array, missing: Array) -> str:
    """The board to add: the usual one, tilted so that its normal gains a good part of the missing direction."""
    normal = np.cos(OBSERVABILITY.added_tilt_rad) * usual + np.sin(OBSERVABILITY.added_tilt_rad) * missing
    if normal[2] < OBSERVABILITY.least_facing:
        # A board must face the camera: tilt the straight view instead, when the usual one turns it away.
        normal = (
            np.cos(OBSERVABILITY.added_tilt_rad) * np.array([0.0, 0.0, 1.0])
            + np.sin(OBSERVABILITY.added_tilt_rad) * missing
        )
        normal = normal / np.linalg.norm(normal)
    axis = np.cross(usual, missing)
    how = (
        "about its upright axis" if abs(axis[1]) >= abs(axis[0]) else "forward or back, about its level axis"
    )
    if abs(axis[2]) > max(abs(axis[0]), abs(axis[1])):
        how = "so that it faces past the camera"
    degrees = np.rad2deg(OBSERVABILITY.added_tilt_rad)
    n = ", ".join(f"{v:.2f}" for v in normal)
    return f"add a board turned {degrees:.0f} deg {how} against the others (normal near ({n}) in the camera frame)"


def _edge_on_words(names: tuple[str, ...]) -> str:
    if not names:
        return ""
    few = ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
    return (
        f"The planes of {len(names)} boards ({few}) pass through a sensor's origin, which leaves the translation "
        "open: hold them so that both sensors see their face."
    )


def is_edge_on(incidence: float) -> bool:
    """Whether a board seen under this cosine passes through the sensor's origin as far as can be told."""
    return not incidence >= OBSERVABILITY.least_incidence


def edge_on_words(sensor: str) -> str:
    """The reason of a pair whose board is seen edge-on by "LiDAR" or "camera"."""
    return f"{EDGE_ON}: the board's plane passes through the {sensor}'s origin"
