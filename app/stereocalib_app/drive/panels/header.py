"""The main panel: which drive, how far it is computed, the presets, and the tabs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panels.corrections import CorrectionsPanel
from stereocalib_app.drive.panels.debug import DebugPanel
from stereocalib_app.drive.panels.exports import ExportPanel
from stereocalib_app.drive.panels.inspect import InspectPanel
from stereocalib_app.drive.panels.opener import OpenPanel
from stereocalib_app.drive.panels.path import PathPanel
from stereocalib_app.drive.panels.teach import TeachPanel
from stereocalib_app.drive.session import Session
from stereocalib_app.drive.settings import PRESETS
from stereocalib_app.widgets import text
from stereocalib_app.widgets.style import chosen, style_sheet
from stereocalib_app.words.lessons import LESSONS

if TYPE_CHECKING:
    from stereocalib_app.drive.page import Page


def drive_title(session: Session) -> str:
    """The drive's name, then in small print what is special about it. Markdown."""
    name, _, options = session.source.name.partition("?")
    facts = [f"{len(session.source)} frames", f"{session.config.method} method"]
    if session.run is not None:
        facts.append(f"run {session.run.name}")
    if session.frames is not None:
        first, end = session.frames
        facts.append(f"frames {first} to {end - 1} of the recording")
    facts += [part.removeprefix("fault=") for part in options.split("&") if part.startswith("fault=")]
    small = text.escape(" · ".join(facts), 160)
    return f'**{text.escape(name, 60)}** <span style="font-size:0.9em;opacity:0.8">{small}</span>'


def drive_line(moment: Moment) -> str:
    """What is open and how it went so far."""
    snapshot = moment.snapshot
    failed = len(snapshot.failures())
    ok = len(snapshot.results) - failed
    title = drive_title(moment.session)
    for line in moment.session.notices:
        title += f"\n\n⚠ {text.escape(line)}"
    if snapshot.problem:
        return f"{title}\n\n⚠ {text.escape(snapshot.problem)}"
    if snapshot.done:
        return f"{title}\n\n{ok} ok · {failed} failed"
    share = 100 * snapshot.progress
    rate = snapshot.frames_per_second
    return f"{title}\n\ncomputing {share:.0f} % · {rate:.1f} frames/s · {ok} ok · {failed} failed"


class HeaderPanel:
    """Docked right."""

    def __init__(self, page: Page) -> None:
        gui = page.gui
        self._page = page
        self._drive = page.add_root(gui.add_markdown(""))
        self._progress = page.add_root(gui.add_progress_bar(0.0))
        page.add_root(gui.add_html(style_sheet()))
        self._chosen = page.add_root(gui.add_html(chosen(0)))
        self._preset = page.add_root(
            gui.add_button_group(
                "View", PRESETS, hint="Inspect a drive, teach the method, or find out why a frame failed."
            )
        )
        page.on_click(self._preset, self.choose)
        self.tabs = page.add_root(gui.add_tab_group())
        self._guides: dict[str, Any] = {}
        self._parts: list[Any] = []
        with self.tabs.add_tab("Guide"):
            for name, build in (("Inspect", InspectPanel), ("Teach", TeachPanel), ("Debug", DebugPanel)):
                self._guides[name] = gui.add_folder(name, visible=name == "Inspect")
                with self._guides[name]:
                    self._parts.append(build(page))
        self.teach: TeachPanel = self._parts[1]
        with self.tabs.add_tab("Correct"):
            self.corrections: CorrectionsPanel = CorrectionsPanel(page)
        with self.tabs.add_tab("Paths"):
            self._parts.append(PathPanel(page))
        with self.tabs.add_tab("Export"):
            self.exports: ExportPanel = ExportPanel(page)
            self._parts.append(self.exports)
        with self.tabs.add_tab("Open"):
            self._parts.append(OpenPanel(page))
        self._parts.append(self.corrections)

    def choose(self, preset: str) -> None:
        """Change the preset; each starts with its own view."""
        layout = LESSONS[self._page.settings.teach_step].layout if preset == "Teach" else "all stages"
        self._page.change(preset=preset, layout=layout)

    def update(self, moment: Moment) -> None:
        """Show progress, the drive's state, and the guide of the preset."""
        own = "" if self._page.owner is None else "\n\n*exploring on your own*"
        self._drive.content = drive_line(moment) + own
        self._progress.value = 100.0 * moment.snapshot.progress
        self._progress.visible = not moment.snapshot.done
        self._chosen.content = chosen(PRESETS.index(moment.settings.preset))
        for name, folder in self._guides.items():
            folder.visible = name == moment.settings.preset
        for part in self._parts:
            part.update(moment)
