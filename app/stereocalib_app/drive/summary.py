"""The drive in a few tables: how it went, and what differs from another run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stereocalib_app.drive.path_state import PathState
from stereocalib_app.drive.session import Snapshot
from stereocalib_app.widgets import palette, text
from stereocalib_app.widgets.tables import color_key, note, numbers_table

AXES = (("height", "height_m", " m"), ("pitch", "pitch_deg", "°"), ("roll", "roll_deg", "°"))
YAW = ("yaw", "yaw_deg", "°")
DIGITS = 3


def drive_summary(snapshot: Snapshot, paths: PathState) -> str:
    """Medians and spreads over the drive, failures by reason, and how far the path ends from the truth."""
    report = snapshot.report
    if not report:
        return note(" · ".join(_facts(snapshot, paths)))
    rows = []
    for name, key, unit in AXES:
        block: Mapping[str, Any] = report.get(key) or {}
        values = [text.number(block.get(part), DIGITS) for part in ("median", "std", "std_filtered")]
        rows.append([f"{name}, {unit.strip()}", *values])
    table = numbers_table("The drive so far" if not snapshot.done else "The drive", HEADER, rows)
    return table + note(" · ".join(_facts(snapshot, paths)))


HEADER = ("", "median", "spread, pair", "spread, filtered")


def _facts(snapshot: Snapshot, paths: PathState) -> list[str]:
    failed = snapshot.report.get("failures") or {}
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
    return facts


def path_table(paths: PathState) -> str:
    """Length, final error and heading error of every path, and the colour of each."""
    rows = []
    if "ground_truth" in paths.poses:
        rows.append([palette.VARIANT_NAME["ground_truth"], *("–",) * 4])
    for name, found in paths.errors.items():
        s = found.summary
        rows.append(
            [
                palette.VARIANT_NAME[name],
                text.number(s.path_m, 1),
                text.number(s.final_translation_m, 2),
                text.number(s.final_translation_percent, 2),
                text.number(s.final_rotation_deg, 2),
            ]
        )
    if not rows:
        return note("The paths appear as soon as some frames are computed.")
    colors = {name: palette.VARIANT[key] for key, name in palette.VARIANT_NAME.items()}
    return numbers_table(
        "Where each path ends [m, %, °]", ("", "length", "error", "%", "heading"), rows, colors
    )


def path_legend(paths: PathState, shown: Mapping[str, bool]) -> str:
    """Which line of the 3-D view is which, as HTML: the paths there are and that are not hidden."""
    present = [
        name for name in palette.VARIANT_NAME if len(paths.poses.get(name, ())) and shown.get(name, True)
    ]
    if not present:
        return ""
    return color_key(
        "Paths in 3-D",
        [
            ("┅" if name == "ground_truth" else "━", palette.VARIANT[name], palette.VARIANT_NAME[name])
            for name in present
        ],
    )


def difference_table(difference: Mapping[str, Any]) -> str:
    """What `compare_runs` found: A is the drive on show, B the run beside it."""
    rows = []
    for name, key, unit in (*AXES, YAW):
        block = difference["mount"].get(key)
        if block is None:
            rows.append([f"{name}, {unit.strip()}", "–", "–", "not known in both"])
            continue
        apart = f"{text.number(block['difference'], DIGITS)} ± {text.number(block['sigma'], DIGITS)}"
        mark = "!" if block["significant"] else ""
        rows.append(
            [
                f"{name}, {unit.strip()}",
                text.number(block["a"], DIGITS),
                text.number(block["b"], DIGITS),
                mark + apart + (" differs" if mark else ""),
            ]
        )
    table = numbers_table("Mount", ("", "this", "other", "other − this"), rows)
    frames, path = difference["frames"], difference["path"]
    if frames is None:
        return table + note("Different drives: frames and paths are not compared.")
    rows = [
        [
            f"{name}, {unit.strip()}",
            *(text.number(frames[key][part], 4) for part in ("median", "rms", "largest")),
        ]
        + [str(frames[key]["largest_at_frame"])]
        for name, key, unit in AXES
        if frames[key] is not None
    ]
    table += numbers_table("Frame by frame", ("", "median", "rms", "largest", "at frame"), rows)
    words = (
        f"{frames['ok_in_both']} of {frames['common']} common frames ok in both, {frames['ok_only_in_a']} only "
        f"here, {frames['ok_only_in_b']} only there."
    )
    if path is not None:
        words += (
            f" Paths of {text.number(path['a_m'], 2)} and {text.number(path['b_m'], 2)} m, apart by "
            f"{text.number(path['rms_difference_m'], 3, ' m')} rms and "
            f"{text.number(path['final_difference_m'], 3, ' m')} at the end, laid together at the first frame."
        )
    return table + note(words)
