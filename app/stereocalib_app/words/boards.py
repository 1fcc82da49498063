"""What the page of a camera and a LiDAR says: Markdown from a snapshot. Pure functions."""

from __future__ import annotations

import numpy as np

from stereocalib_app.boards.session import NO_NUDGE, LidarSnapshot
from stereocalib_app.widgets import palette, text
from stereocalib_core.boards import Calibration
from stereocalib_core.boards.rotations import rotation_angle

VERDICT_COLORS = {"good": palette.ROAD, "weak": palette.NOW, "degenerate": palette.FAILED}
AXES = ("x", "y", "z")


def headline(snapshot: LidarSnapshot, folder: str, watching: bool = False) -> str:
    """Which folder, and how far it is."""
    name = f"**{text.escape(folder, 60)}**"
    title = f"{name} · {snapshot.total} pairs"
    grows = "\n\nNew pairs in the folder are taken in by themselves." if watching else ""
    if snapshot.problem:
        return f"{title}\n\n⚠ {text.escape(snapshot.problem)}{grows}"
    if snapshot.busy:
        return f"{title}\n\n{text.escape(snapshot.stage)}: {snapshot.done} of {snapshot.total}"
    if snapshot.result is None:
        return f"{title}\n\nsolving"
    used = sum(p.ok for p in snapshot.result.pairs)
    solved = f"solved in {1000 * snapshot.solve_s:.0f} ms"
    return f"{name} · {used} of {len(snapshot.result.pairs)} pairs used · {solved}{grows}"


def verdict(snapshot: LidarSnapshot) -> str:
    """Good, weak or degenerate, and why."""
    result = snapshot.result
    if result is None:
        return ""
    color = palette.css(VERDICT_COLORS[result.verdict])
    advice = " **Do not use this result.**" if result.degenerate else ""
    return (
        f'<span style="color:{color}">●</span> **{result.verdict}**: {text.escape(result.observability.why, 700)}'
        f"{advice}{_causes(snapshot)}"
    )


def _causes(snapshot: LidarSnapshot) -> str:
    """Causes and remedies, and the pose to add: what the ghost in the 3-D view shows."""
    answer = snapshot.answer
    if answer is None:
        return ""
    said = [f"\n\n{text.escape(f.cause, 400)}: *{text.escape(f.remedy, 300)}*" for f in answer.findings]
    if answer.pose is not None:
        said.append(f"\n\n**Next** (the dashed blue board in 3-D): {text.escape(answer.pose.words(), 400)}.")
    return "".join(said)


def result_tables(snapshot: LidarSnapshot) -> str:
    """The transform both ways, its sigma, the residuals, and what the ticks changed."""
    result = snapshot.result
    if result is None:
        return "No result yet."
    back = result.T_lidar_camera[:3, 3]
    t, s = result.T_camera_lidar[:3, 3], result.sigma_translation_m
    shift = [
        [axis, text.with_sigma(1000 * t[i], 1000 * s[i], 1, " mm"), text.number(1000 * back[i], 1, " mm")]
        for i, axis in enumerate(AXES)
    ]
    rpy, turn = np.rad2deg(result.rotation_rpy_rad), np.rad2deg(result.sigma_rotation_rad)
    angles = [
        [name, text.number(rpy[i], 3, "°"), f"{axis}: {text.number(turn[i], 3, '°')}"]
        for i, (name, axis) in enumerate(zip(("roll", "pitch", "yaw"), AXES, strict=True))
    ]
    held = result.held_out
    errors = [
        ["cloud to board", _mm(result.plane_rms_m), _mm(held.plane_rms_m)],
        ["corners", text.number(result.reprojection_rms_px, 2, " px"),
         text.number(held.reprojection_rms_px, 2, " px")],
    ]  # fmt: skip
    values = ", ".join(f"{v:.2f}" for v in result.observability.singular_values)
    return "\n\n".join(
        (
            text.table(["", "LiDAR in camera", "camera in LiDAR"], shift),
            text.table(["", "T_camera_lidar", "σ about camera"], angles),
            text.table(["rms", "these pairs", "held out"], errors),
            f"{_change(snapshot)}Spread of the board normals {values}: three clear values see every direction.",
        )
    )


def _mm(value_m: float) -> str:
    return text.number(1000 * value_m, 1, " mm")


def _change(snapshot: LidarSnapshot) -> str:
    """How far the ticks moved the result."""
    result, first = snapshot.result, snapshot.first
    if result is None or first is None or result is first or not snapshot.solved_for:
        return ""
    turn_deg, shift_m = difference(result, first)
    return f"**Ticks moved it by {1000 * shift_m:.1f} mm and {turn_deg:.3f}°** from all pairs.\n\n"


def difference(a: Calibration, b: Calibration) -> tuple[float, float]:
    """Turn [deg] and shift [m] between two results."""
    turn = np.rad2deg(rotation_angle(a.T_camera_lidar[:3, :3] @ b.T_camera_lidar[:3, :3].T))
    return float(turn), float(np.linalg.norm(a.T_camera_lidar[:3, 3] - b.T_camera_lidar[:3, 3]))


def nudge_words(snapshot: LidarSnapshot) -> str:
    """Residuals before and under the nudge."""
    result, trial = snapshot.result, snapshot.trial
    if result is None:
        return ""
    if trial is None or snapshot.wish.nudge == NO_NUDGE:
        return f"As solved: cloud to board **{_mm(result.plane_rms_m)}** rms."
    worse = trial.total_rms_m / max(result.plane_rms_m, 1e-12)
    return (
        f"Nudged: cloud to board **{_mm(trial.total_rms_m)}** rms, solved {_mm(result.plane_rms_m)} (×{worse:.2f}). "
        "The rows under Pairs show each board."
    )


def pair_words(snapshot: LidarSnapshot, name: str) -> str:
    """One line on the pair on show."""
    index, total = snapshot.wish.pair, snapshot.total
    line = f"Pair {index + 1} of {total}: **{text.escape(name, 60)}**"
    if snapshot.result is None:
        return line
    pair = snapshot.result.pairs[index]
    if not pair.ok:
        return f"{line} · {text.escape(pair.reason, 200)}"
    rms = pair.plane_rms_m if snapshot.trial is None else float(snapshot.trial.plane_rms_m[index])
    return (
        f"{line} · cloud to board {_mm(rms)} · corners {text.number(pair.reprojection_rms_px, 2, ' px')} · "
        f"normals {text.number(pair.normal_error_deg, 2, '°')}"
    )
