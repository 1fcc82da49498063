"""The drive in a few tables: how it went, and what differs from another run."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stereocalib_app.drive.path_state import PathState
from stereocalib_app.drive.session import Snapshot
from stereocalib_app.widgets import canvas, palette, text
from stereocalib_app.widgets.tables import color_key, color_scale, note, numbers_table
from stereocalib_core.results import TO_DEGREES
from stereocalib_core.results.difference import Difference

AXES = (("height", "height_m", " m"), ("pitch", "pitch_rad", "°"), ("roll", "roll_rad", "°"))
YAW = ("yaw", "yaw_rad", "°")
DIGITS = 3


def drive_summary(snapshot: Snapshot, paths: PathState) -> str:
    """Medians and spreads over the drive, failures by reason, and how far the path ends from the truth."""
    if snapshot.drive is None:
        return note(" · ".join(_facts(snapshot, paths)))
    rows = []
    for (name, _, unit), spread in zip(
        AXES, snapshot.drive.frames.statistics(TO_DEGREES).values(), strict=True
    ):
        values = [text.number(value, DIGITS) for value in (spread.median, spread.std, spread.std_filtered)]
        rows.append([f"{name}, {unit.strip()}", *values])
    table = numbers_table("The drive so far" if not snapshot.done else "The drive", HEADER, rows)
    return table + note(" · ".join(_facts(snapshot, paths)))


HEADER = ("", "median", "spread, pair", "spread, filtered")


def _facts(snapshot: Snapshot, paths: PathState) -> list[str]:
    failed = {} if snapshot.drive is None else snapshot.drive.frames.failures
    count = sum(failed.values())
    facts = [f"{len(snapshot.results) - len(snapshot.failures())} of {snapshot.total} frames ok"]
    if count:
        facts.append("failed: " + ", ".join(f"{n} {reason}" for reason, n in failed.items()))
    best = paths.errors.get("autocalibrated")
    if best is not None:
        facts.append(f"path {text.number(best.summary.path_m, 1, ' m')}")
        if best.summary.final_translation_m is not None:
            percent = text.number(best.summary.final_translation_percent, 2, " %")
            facts.append(
                f"ends {text.number(best.summary.final_translation_m, 2, ' m')} ({percent}) off the truth"
            )
        if best.summary.t_rel_percent is not None:
            facts.append(f"t_rel {text.number(best.summary.t_rel_percent, 2, ' %')}")
        if best.summary.path_m is None:
            facts[-1] = "path: a gap, most of the way shows no road"
    return facts


def alike_words(paths: PathState, model: str) -> str:
    """Why two paths that are told apart show the same numbers; empty where they do not."""
    best, other = (paths.poses.get(name) for name in ("autocalibrated", "no_yaw"))
    if best is None or other is None or best.shape != other.shape:
        return ""
    if not np.allclose(best, other, atol=1e-6, equal_nan=True):
        return ""
    if model != "nonholonomic":
        return YAW_NOT_NEEDED
    return "No yaw and autocalibrated are the same path here: this drive has shown no yaw."


YAW_NOT_NEEDED = (
    "No yaw and autocalibrated are the same path here, and that is right: the full and the planar model measure how "
    "the camera itself moves, whatever way it is mounted in the car. The yaw of the mount matters to the "
    "nonholonomic model (Correct, Motion), which knows how the car can move and not the camera."
)


def path_table(paths: PathState, model: str = "full") -> str:
    """Length, final error, t_rel and heading error of every path, and the colour of each."""
    rows = []
    if "ground_truth" in paths.poses:
        rows.append([palette.VARIANT_NAME["ground_truth"], *("–",) * 5])
    for name, found in paths.errors.items():
        s = found.summary
        rows.append(
            [
                palette.VARIANT_NAME[name],
                text.number(s.path_m, 1),
                text.number(s.final_translation_m, 2),
                text.number(s.final_translation_percent, 2),
                text.number(s.t_rel_percent, 2),
                text.number(s.final_rotation_deg, 2),
            ]
        )
    if not rows:
        return note("The paths appear as soon as some frames are computed.")
    colors = {name: palette.VARIANT[key] for key, name in palette.VARIANT_NAME.items()}
    alike = alike_words(paths, model)
    return numbers_table(
        "Where each path ends [m, %, °; t_rel in %]",
        ("", "length", "error", "%", "t_rel", "turn"),
        rows,
        colors,
    ) + (note(alike) if alike else "")


def path_legend(paths: PathState, shown: Mapping[str, bool], by_error: bool = False) -> str:
    """Which line of the 3-D view is which, as HTML: the paths there are and that are not hidden, and what the
    colours of the autocalibrated one mean where it is coloured by its error."""
    present = [
        name for name in palette.VARIANT_NAME if len(paths.poses.get(name, ())) and shown.get(name, True)
    ]
    if not present:
        return ""
    key = color_key(
        "Paths in 3-D",
        [
            ("┅" if name == "ground_truth" else "━", palette.VARIANT[name], palette.VARIANT_NAME[name])
            for name in present
            if not (by_error and name == COLORED)
        ],
    )
    return key + error_scale(paths) if by_error else key


COLORED = "autocalibrated"
"""The path that is coloured by its error."""


def largest_miss_m(paths: PathState) -> float | None:
    """The largest distance of the coloured path from the truth [m], None where no truth tells it."""
    found = paths.errors.get(COLORED)
    if found is None or found.miss_m is None or not np.isfinite(found.miss_m).any():
        return None
    return float(np.nanmax(found.miss_m))


def error_scale(paths: PathState) -> str:
    """The colours of the path that is coloured by its error, dark to bright, as a bar in metres."""
    largest = largest_miss_m(paths)
    if largest is None:
        return note("The path cannot be coloured: no truth here is good for an error of position.")
    table = canvas.lookup_table(canvas.ERRORS)[:: 255 // 8]
    colors = [(int(r), int(g), int(b)) for r, g, b in table]
    title = "Autocalibrated path, off the truth by"
    return color_scale(title, colors, "0 m", text.number(largest, 2, " m")) + note("Grey: no truth there.")


def difference_table(difference: Difference) -> str:
    """What `compare` found: A is the drive on show, B the run beside it."""
    rows = []
    for name, key, unit in (*AXES, YAW):
        found = difference.mount[key]
        if found is None:
            rows.append([f"{name}, {unit.strip()}", "–", "–", "not known in both"])
            continue
        factor = shown_unit(key)
        numbers = (found.a.value, found.b.value, found.difference, found.sigma)
        a, b, apart, sigma = (text.number(factor * value, DIGITS) for value in numbers)
        words = f"!{apart} ± {sigma} differs" if found.significant else f"{apart} ± {sigma}"
        rows.append([f"{name}, {unit.strip()}", a, b, words])
    table = numbers_table("Mount", ("", "this", "other", "other − this"), rows)
    frames, path = difference.frames, difference.path
    if frames is None:
        return table + note("Different drives: frames and paths are not compared.")
    rows = []
    for name, key, unit in AXES:
        over = frames.axes[key]
        if over is not None:
            values = (shown_unit(key) * value for value in (over.median, over.rms, over.largest))
            cells = [text.number(value, 4) for value in values]
            rows.append([f"{name}, {unit.strip()}", *cells, str(over.largest_at_frame)])
    table += numbers_table("Frame by frame", ("", "median", "rms", "largest", "at frame"), rows)
    words = (
        f"{frames.ok_in_both} of {frames.common} common frames ok in both, {frames.ok_only_in_a} only "
        f"here, {frames.ok_only_in_b} only there."
    )
    if path is not None:
        words += (
            f" Paths of {text.number(path.a_m, 2)} and {text.number(path.b_m, 2)} m, apart by "
            f"{text.number(path.rms_difference_m, 3, ' m')} rms and "
            f"{text.number(path.final_difference_m, 3, ' m')} at the end, laid together at the first frame."
        )
    return table + note(words)


def shown_unit(field: str) -> float:
    """The factor from a field's unit to the one on the page."""
    return float(np.rad2deg(1.0)) if field.endswith("_rad") else 1.0
