"""The answer first: how the camera is mounted, as lines of text and as Markdown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from app import palette, text
from app.session import Snapshot

MOUNT = (("height", "height_m", 3, " m"), ("pitch", "pitch_deg", 3, "°"), ("roll", "roll_deg", 3, "°"))


def _measured(block: Any, digits: int, unit: str) -> str:
    if not isinstance(block, Mapping):
        return "–"
    return text.with_sigma(block.get("value"), block.get("sigma"), digits, unit)


def shift_words(shift: Mapping[str, Any]) -> str:
    """A shift of the mount in words."""
    return (
        f"{shift['kind']} of {shift['axis']} {shift['size']:+.3g} {shift['unit']} at frame {shift['frame']}"
    )


def mount_rows(snapshot: Snapshot) -> list[tuple[str, str]]:
    """Name and value of every line of the card."""
    report = {} if snapshot.analysis is None else snapshot.analysis.report
    mount = report.get("mount") or {}
    rows = [(name, _measured(mount.get(key), digits, unit)) for name, key, digits, unit in MOUNT]
    yaw = _measured(mount.get("yaw_deg"), 3, "°")
    if yaw == "–" and report.get("yaw_reason"):
        yaw = f"not known: {report['yaw_reason']}"
    rows.append(("yaw", yaw))
    rectification = report.get("rectification") or {}
    if rectification:
        rows.append(("pair", str(rectification.get("verdict", "–"))))
        rows.append(("pair, why", str(rectification.get("why", "–"))))
    within = mount.get("within_tolerance")
    if within is not None:
        rows.append(("tolerance", "within" if within else "OUTSIDE"))
    shifts = report.get("shifts") or []
    if snapshot.analysis is not None:
        rows.append(("shifts", "; ".join(shift_words(s) for s in shifts[:6]) or "none"))
    return rows


def median_rows(snapshot: Snapshot) -> list[tuple[str, str]]:
    """Medians over the frames computed so far, until the whole drive is analysed."""
    values = np.array(
        [
            (r.road.extrinsics.height_m, r.road.extrinsics.pitch_deg, r.road.extrinsics.roll_deg)
            for r in snapshot.results
            if r.road is not None
        ]
    )
    if len(values) == 0:
        return [(name, "–") for name, *_ in MOUNT]
    middle, spread = np.median(values, axis=0), values.std(axis=0)
    return [
        (name, f"{text.number(middle[i], digits, unit)} (spread {text.number(spread[i], digits, unit)})")
        for i, (name, _key, digits, unit) in enumerate(MOUNT)
    ]


def card_rows(snapshot: Snapshot) -> tuple[str, list[tuple[str, str]]]:
    """Title and lines of the card."""
    if snapshot.analysis is not None and (snapshot.analysis.report.get("mount") or {}).get("height_m"):
        state = "" if snapshot.done else " (so far)"
        return f"How this camera is mounted{state}", mount_rows(snapshot)
    return "How this camera is mounted (median so far)", median_rows(snapshot)


def card_text(name: str, snapshot: Snapshot) -> str:
    """The card as plain text, to be copied."""
    title, rows = card_rows(snapshot)
    failed = len(snapshot.failures())
    lines = [f"{name}: {title.lower()}", f"frames: {len(snapshot.results)} computed, {failed} failed"]
    return "\n".join(lines + [f"{key}: {value}" for key, value in rows])


def card_markdown(snapshot: Snapshot) -> str:
    """The card as Markdown."""
    title, rows = card_rows(snapshot)

    def value_of(key: str, value: str) -> str:
        shown = text.escape(value, 160)
        alarming = (key in ("pair", "tolerance") and value not in ("good", "within", "–")) or (
            key == "shifts" and value != "none"
        )
        return (
            f'<span style="color:{palette.css(palette.FAILED)}">**⚠ {shown}**</span>' if alarming else shown
        )

    lines = [[f"**{key}**", value_of(key, value)] for key, value in rows if key != "pair, why"]
    why = "".join(
        f'\n\n<span style="font-size:0.8em;opacity:0.75">Stereo pair: {text.escape(value, 400)}</span>'
        for key, value in rows
        if key == "pair, why"
    )
    return f"**{title}**\n\n{text.table(['', ''], lines)}{why}"
