"""The guided walk through the method: what each step shows, its equation, and what can be broken to see why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import cv2
import numpy as np
from latex2mathml.converter import convert

from stereocalib_app.drive.settings import Corrections
from stereocalib_core.config import DisparityConfig, FreeMapConfig, PipelineConfig, ProfileConfig
from stereocalib_core.frames import StereoFrame
from stereocalib_core.geometry import StereoCamera
from stereocalib_core.results import Measured


@dataclass(frozen=True)
class Breakage:
    """Something to break: `label` on the button, what it does to the corrections or to the stages on show.

    corrections: fields of `Corrections` to change. stages: parts of the configuration to change, display only.
    effect: what to look at afterwards.
    """

    label: str
    effect: str
    corrections: Mapping[str, Any] | None = None
    stages: str = ""


@dataclass(frozen=True)
class Lesson:
    """One step: its title, the view it sets, its equations in LaTeX (one a line), and a few sentences."""

    title: str
    layout: str
    latex: tuple[str, ...]
    words: str
    breakage: Breakage


MATH_FONTS: Final = "'Latin Modern Math','STIX Two Math','Cambria Math','Noto Sans Math',math"
LARGEST_EM: Final = 1.25
_FIT: Final = (
    f"const e=this.parentNode,fit=()=>{{e.style.fontSize='{LARGEST_EM}em';const w=e.scrollWidth;"
    f"if(w>e.clientWidth)e.style.fontSize=0.98*{LARGEST_EM}*e.clientWidth/w+'em'}};"
    "new ResizeObserver(fit).observe(e);document.fonts.ready.then(fit)"
)
"""How wide an equation is depends on the fonts of the machine: only the browser can measure it. A style element
tells when it is in the page, also where scripts among inserted HTML are not run."""

BENDS_DEG: Final = tuple(step / 50 for step in range(-15, 16))
"""What the right camera can be turned by, a finger's width of the slider apart."""
TURN_DEG: Final = 0.1


def turned_stage(bend_deg: float) -> str:
    """The stages of a pair whose right camera is turned by one of `BENDS_DEG`; empty for none."""
    return f"right camera turned by {bend_deg:+.2f} deg" if bend_deg else ""


TURNED: Final = {turned_stage(bend): float(np.deg2rad(bend)) for bend in BENDS_DEG if bend}
"""The angle [rad] of each."""

BROKEN_STAGES: Final[dict[str, Mapping[str, Any]]] = {
    **{stage: {} for stage in TURNED},
    "short search": {"disparity": DisparityConfig(max_disparity_px=32)},
    "no obstacles": {"free_map": FreeMapConfig(road_margin=1000.0)},
    "wide corridor": {"profile": ProfileConfig(corridor_half_width_m=20.0)},
}


def turned(frame: StereoFrame, camera: StereoCamera, turn_rad: float) -> StereoFrame:
    """The pair as if its right camera had turned by so much about its own vertical, for display only."""
    if frame.right is None:
        return frame
    rows, columns = frame.right.shape
    u, v = np.meshgrid(np.arange(columns, dtype=np.float32), np.arange(rows, dtype=np.float32))
    cx = camera.cx_px if camera.cx_right_px is None else camera.cx_right_px
    x, y = (u - np.float32(cx)) / camera.focal_px, (v - camera.cy_px) / camera.focal_px
    shift = np.float32(camera.focal_px * turn_rad)
    moved = cv2.remap(frame.right, u + shift * (1 + x * x), v + shift * x * y, cv2.INTER_LINEAR)
    return replace(frame, right=np.asarray(moved, dtype=np.uint8))


def bend_words(bend_deg: float, found: Measured | None, recorded: Measured | None) -> str:
    """One sentence: does the measurement find what the slider did?"""
    if found is None or recorded is None:
        return "The motion of so few frames does not show the pair's yaw."
    change, sigma = np.rad2deg([found.value - recorded.value, np.hypot(found.sigma, recorded.sigma)])
    if not bend_deg:
        return "Move the slider: rows stay as they are, the road tilts, the path stretches."
    return (
        f"The slider turned the right camera by {bend_deg:+.2f}°, motion finds {change:+.4f} ± {sigma:.4f}° of change, "
        "and no row has moved."
    )


def broken_config(config: PipelineConfig, stages: str) -> PipelineConfig:
    """The configuration with a stage broken, for display only."""
    return replace(config, **BROKEN_STAGES.get(stages, {}))


LESSONS: Final[tuple[Lesson, ...]] = (
    Lesson(
        "Disparity",
        "disparity",
        (r"\Delta = \frac{\alpha\, b}{S}",),
        "Each pixel of the left image is looked for in the same row of the right one. How far it moved is its "
        "disparity Δ: large when near, zero at infinity. Focal length α and baseline b turn it into depth S.",
        Breakage(
            "Search only 32 px", "the near road and near cars lose their disparity", stages="short search"
        ),
    ),
    Lesson(
        "u-disparity",
        "u-disparity",
        (r"n(\Delta, u) = \#\{\, v : \Delta(u, v) = \Delta \,\}",),
        "Count, in every column, how often each disparity occurs. A wall or a car keeps one disparity over many "
        "rows and piles up (orange). The road changes with every row and spreads thin (blue).",
        Breakage("Accept every pile as road", "nothing is orange any more", stages="no obstacles"),
    ),
    Lesson(
        "Free map",
        "free map",
        (r"\text{free} = \{\, (u, v) : n(\Delta(u, v), u) \le n_\text{road} \,\}",),
        "Take the piles out, cells with more in them than a road can bring, and the free map is left: where a car "
        "could stand. Only here the road is looked for. Green cells agree with the plane that is found in the end.",
        Breakage("Keep cars and walls", "walls and cars count as free", stages="no obstacles"),
    ),
    Lesson(
        "v-disparity",
        "v-disparity",
        (r"v = C_r\, \Delta + v_{\Delta 0}",),
        "Count, in every row of the free map, how often each disparity occurs. All of a flat road falls on one "
        "straight line, the road profile (yellow).",
        Breakage("Whole map instead of free map", "the line drowns in walls and cars", stages="no obstacles"),
    ),
    Lesson(
        "Pitch and height",
        "v-disparity",
        (r"\theta = \arctan\,\frac{v_0 - v_{\Delta 0}}{\alpha}", r"h = C_r\, b\, \cos\theta"),
        "Where the profile meets disparity zero lies the horizon: that is the pitch θ. The slope of the profile "
        "is the height h over the baseline b.",
        Breakage(
            "Add 1° of pitch",
            "the live horizon and road (blue) leave the picture's road; the path bends",
            corrections={"pitch_error_deg": 1.0},
        ),
    ),
    Lesson(
        "Roll",
        "left image",
        (r"v = C\, u + d \quad\text{at one } \Delta", r"\rho = \arctan(C\, \cos\theta)"),
        "At one fixed disparity the road is a line across the image. Its slope C gives the roll ρ. No trial "
        "projections are needed.",
        Breakage(
            "Add 2° of roll",
            "the lines of one disparity (orange) and the live road tilt against the real one",
            corrections={"roll_error_deg": 2.0},
        ),
    ),
    Lesson(
        "Direct alignment",
        "left − right",
        (
            r"\min_{A, B, C} \sum w\, (I_L(u, v) - I_R(u - \Delta, v) - b)^2",
            r"\Delta = A\, \bar v + B\, \bar u + C",
        ),
        "A matcher rounds disparities. The pictures themselves do not: warp the right one over the road plane and "
        "subtract. Where the plane (A, B, C) is right the road vanishes into an even grey; the three numbers are moved "
        "until it does.",
        Breakage(
            "Add 0.5° of pitch",
            "stripes of red and blue appear on the road",
            corrections={"pitch_error_deg": 0.5},
        ),
    ),
    Lesson(
        "Yaw",
        "left image",
        (r"d = R^T K^{-1}\, (u_\text{vp},\, v_\text{vp},\, 1)^T", r"\varphi = \text{atan2}(d_x,\, d_z)"),
        "When the car drives straight, the tracks on the road meet in one point, the vanishing point of travel. "
        "Its direction d, with pitch and roll (R) and the camera (K) taken out, is the yaw φ. Only straight driving "
        "shows it.",
        Breakage(
            "Take yaw out (no side slip)",
            "with a model that forbids side slip, every metre turns the path a little",
            corrections={"yaw_strength": 0.0, "model": "nonholonomic"},
        ),
    ),
    Lesson(
        "The pair's own yaw",
        "left image",
        (r"\Delta' = \Delta + \alpha\, (1 + x^2)\, \psi", r"\theta' \approx \theta + \frac{h}{b}\, \psi"),
        "If one camera has turned against the other by ψ, no row shows it: every disparity is off by nearly the same. "
        "The road then seems tilted: a tenth of a degree is a third of a degree of pitch here. Motion shows it, "
        "because near and far points want different ways. The slider below bends the pair of this very drive.",
        Breakage(
            "Turn the right camera by 0.1°",
            "the yellow horizon moves although all rows still match",
            stages=turned_stage(TURN_DEG),
        ),
    ),
    Lesson(
        "Filter",
        "left image",
        (r"x_{k+1} = f(x_k) + w_k", r"z_k = h(x_k) + n_k"),
        "The car's body swings on its springs about a mount that hardly moves. The filter knows both, weighs each "
        "measurement by its σ, and predicts through failed frames (marked, σ growing). It measures in the disparity "
        "plane, where the noise is Gaussian: the inset shows this pair's ellipse and the filter's sigma points.",
        Breakage(
            "Use each pair alone",
            "the value used (blue cross) jumps from the filter's points to the middle of this pair's ellipse",
            corrections={"source": "raw"},
        ),
    ),
    Lesson(
        "Odometry",
        "left image",
        (
            r"\Delta = \frac{b}{h}\, (\cos\rho \cos\theta\; \bar v - \sin\rho\; \bar u + \alpha \cos\rho \sin\theta)",
            r"X = \frac{b}{\Delta}\, (\cos\rho\; \bar u + \sin\rho\, (\cos\theta\; \bar v + \alpha\, \sin\theta))",
            r"Z = \frac{b}{\Delta}\, (\alpha\, \cos\theta - \sin\theta\; \bar v)",
            r"T_{k+1} = T_k\; T_{k \to k+1}",
        ),
        "Points tracked on the road (green) become metres by height, pitch and roll (ū, v̄: from the principal point): "
        "the map from above shows where they were (end of the line), where they are (dot), and the path that such "
        "motions add up to, with every error of the calibration. The default model weighs that depth against the "
        "measured disparity, so errors show less in it; the planar one, the paper's, trusts it alone.",
        Breakage(
            "Take pitch and roll out",
            "the path shrinks or grows and bends: calibration matters",
            corrections={"pitch_strength": 0.0, "roll_strength": 0.0},
        ),
    ),
)


def broken_corrections(breakage: Breakage) -> Corrections:
    """The corrections of a breakage."""
    return Corrections(**(breakage.corrections or {}))


def equation_html(latex: Sequence[str]) -> str:
    """Equations, one a line, as MathML, which browsers typeset themselves; too wide a one is set smaller."""
    lines = "".join(f'<div style="margin:0.35em 0">{convert(line, display="block")}</div>' for line in latex)
    style = f"font-family:{MATH_FONTS};padding:0.2em 0.4em 0.5em;overflow:hidden;font-size:{LARGEST_EM}em"
    return f'<div class="equations" style="{style}"><style onload="{_FIT}"></style>{lines}</div>'
