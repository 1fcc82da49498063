"""The main panel: which drive, how far it is computed, and the presets."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app import text
from app.moment import Moment
from app.settings import PRESETS

if TYPE_CHECKING:
    from app.page import Page


def drive_line(moment: Moment) -> str:
    """What is open and how it went so far."""
    snapshot, source = moment.snapshot, moment.session.source
    failed = len(snapshot.failures())
    ok = len(snapshot.results) - failed
    lines = [
        f"**{text.escape(source.name, 60)}** · {len(source)} frames · method {moment.session.config.method}"
    ]
    if snapshot.problem:
        lines.append(f"⚠ {text.escape(snapshot.problem)}")
    elif snapshot.done:
        lines.append(f"{ok} ok · {failed} failed")
    else:
        share = 100 * snapshot.progress
        lines.append(
            f"computing {share:.0f} % · {snapshot.frames_per_second:.1f} frames/s · {ok} ok · {failed} failed"
        )
    return "\n\n".join(lines)


class HeaderPanel:
    """Docked right."""

    def __init__(self, page: Page) -> None:
        gui = page.gui
        self._drive = page.add_root(gui.add_markdown(""))
        self._progress = page.add_root(gui.add_progress_bar(0.0))
        self._preset = page.add_root(
            gui.add_button_group(
                "View", PRESETS, hint="Inspect a drive, teach the method, or find out why a frame failed."
            )
        )
        page.on_click(self._preset, lambda value: page.change(preset=value))

    def update(self, moment: Moment) -> None:
        """Show progress and the drive's state."""
        self._drive.content = drive_line(moment)
        self._progress.value = 100.0 * moment.snapshot.progress
        self._progress.visible = not moment.snapshot.done
