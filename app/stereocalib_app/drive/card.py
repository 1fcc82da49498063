"""The answer first: how the camera is mounted, as rows that become a card on the page or lines of text."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from stereocalib_app.drive.session import Snapshot
from stereocalib_app.widgets import text
from stereocalib_app.widgets.card import CardRow, card

MOUNT = (
    ("height", "height_m", " m"),
    ("pitch", "pitch_deg", "°"),
    ("roll", "roll_deg", "°"),
    ("yaw", "yaw_deg", "°"),
)
DIGITS = 3
SHIFTS_SHOWN = 6


def plain_units(line: str) -> str:
    """A line of the report in the page's spelling: ±, °, a real minus, and no sign before a nought."""
    line = re.sub(r"[+-](?=0\.0+(?![\d.]))", "", line.replace("+-", "±"))
    return line.replace(" deg", "°").replace("-0.", "−0.")


def shift_words(shift: Mapping[str, Any]) -> str:
    """A shift of the mount in words."""
    size = text.number(shift["size"], 3, "°" if shift["unit"] == "deg" else f" {shift['unit']}")
    sign = "" if shift["size"] < 0 else "+"
    return f"{shift['kind']} of {shift['axis']} {sign}{size} at frame {shift['frame']}"


def limit_words(limit: Mapping[str, Any] | None, unit: str) -> tuple[str, bool]:
    """The verdict on one axis, and whether it is bad."""
    if not limit:
        return "", False
    allowed = f"{limit['nominal']:g} ± {limit['tolerance']:g}{unit}".replace("-", "−")
    if limit["within"] is None:
        return f"not measured, allowed {allowed}", True
    return (f"✓ within {allowed}", False) if limit["within"] else (f"✗ OUTSIDE {allowed}", True)


def mount_rows(report: Mapping[str, Any]) -> list[CardRow]:
    """The lines of the card of an analysed drive, from report.json."""
    mount = report.get("mount") or {}
    limits = mount.get("tolerance") or {}
    rows = []
    for name, key, unit in MOUNT:
        block = mount.get(key)
        value = "–" if not block else text.with_sigma(block.get("value"), block.get("sigma"), DIGITS, unit)
        if name == "yaw" and value == "–" and report.get("yaw_reason"):
            value = f"not known: {report['yaw_reason']}"
        rows.append(CardRow(name, value, *limit_words(limits.get(key), unit)))
    within = mount.get("within_tolerance")
    if limits or within is not None:
        words = "✓ mount within tolerance" if within else "✗ mount OUTSIDE tolerance"
        if within is None:
            words = "not every axis measured"
        rows.append(CardRow("tolerance", words, bad=not within))
    verdict = (report.get("rectification") or {}).get("verdict")
    if verdict is not None:
        rows.append(CardRow("stereo pair", str(verdict), bad=verdict != "good"))
    shifts = [shift_words(s) for s in report.get("shifts") or []]
    more = f"; and {len(shifts) - SHIFTS_SHOWN} more" if len(shifts) > SHIFTS_SHOWN else ""
    rows.append(CardRow("shifts", "; ".join(shifts[:SHIFTS_SHOWN]) + more or "none", bad=bool(shifts)))
    return rows


def median_rows(snapshot: Snapshot) -> list[CardRow]:
    """Medians over the frames computed so far, until the whole drive is analysed."""
    roads = [r.road.extrinsics for r in snapshot.results if r.road is not None]
    if not roads:
        return [CardRow(name, "–") for name, *_ in MOUNT[:3]]
    values = np.array([(e.height_m, e.pitch_deg, e.roll_deg) for e in roads])
    middle, spread = np.median(values, axis=0), values.std(axis=0)
    return [
        CardRow(
            name, f"{text.number(middle[i], DIGITS, unit)} (spread {text.number(spread[i], DIGITS, unit)})"
        )
        for i, (name, _key, unit) in enumerate(MOUNT[:3])
    ]


def card_rows(snapshot: Snapshot) -> tuple[str, list[CardRow]]:
    """Title and lines of the card."""
    if (snapshot.report.get("mount") or {}).get("height_m"):
        state = "" if snapshot.done else ", so far"
        return f"How this camera is mounted{state}", mount_rows(snapshot.report)
    return "How this camera is mounted, median so far", median_rows(snapshot)


def pair_words(snapshot: Snapshot) -> str:
    """What the rows of left and right say of the pair, or nothing."""
    return plain_units(str((snapshot.report.get("rectification") or {}).get("why") or ""))


def card_text(name: str, snapshot: Snapshot) -> str:
    """The card as plain text, to be copied."""
    title, rows = card_rows(snapshot)
    failed = len(snapshot.failures())
    lines = [f"{name}: {title.lower()}", f"frames: {len(snapshot.results)} computed, {failed} failed"]
    lines += [row.line for row in rows]
    why = pair_words(snapshot)
    return "\n".join(lines + ([f"stereo pair, why: {why}"] if why else []))


def card_html(snapshot: Snapshot) -> str:
    """The card for the page; every string in it is escaped."""
    title, rows = card_rows(snapshot)
    return card(title, rows, (pair_words(snapshot),))
