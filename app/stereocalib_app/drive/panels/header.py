"""The main panel: which drive, how far it is computed, the presets, and the tabs."""

from __future__ import annotations

from typing import Any

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host, Panel
from stereocalib_app.drive.panels.table import GUIDES, TABS
from stereocalib_app.drive.session import Session
from stereocalib_app.drive.settings import PRESETS
from stereocalib_app.widgets import text
from stereocalib_app.widgets.style import chosen, style_sheet


def drive_title(session: Session) -> str:
    """The drive's name, then in small print what is special about it. Markdown."""
    name, _, options = session.source.name.partition("?")
    facts = [f"{len(session.source)} frames", f"{session.config.method} method"]
    if session.run_folder is not None:
        facts.append(f"run {session.run_folder.name}")
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
    if len(snapshot.results) == snapshot.total:
        return f"{title}\n\nall frames looked at · putting the drive together · {ok} ok · {failed} failed"
    share = 100 * snapshot.progress
    rate = snapshot.frames_per_second
    left = "" if rate <= 0 else f" · {text.duration((snapshot.total - len(snapshot.results)) / rate)} left"
    return f"{title}\n\ncomputing {share:.0f} % · {rate:.1f} frames/s{left} · {ok} ok · {failed} failed"


class HeaderPanel:
    """Docked right."""

    def __init__(self, host: Host) -> None:
        gui = host.gui
        self._host = host
        self._drive = host.add_root(gui.add_markdown(""))
        self._progress = host.add_root(gui.add_progress_bar(0.0))
        host.add_root(gui.add_html(style_sheet()))
        self._chosen = host.add_root(gui.add_html(chosen(0)))
        self._preset = host.add_root(
            gui.add_button_group(
                "View", PRESETS, hint="Inspect a drive, teach the method, or find out why a frame failed."
            )
        )
        host.on_click(self._preset, host.choose)
        tabs = host.add_root(gui.add_tab_group())
        self._guides: dict[str, Any] = {}
        self.parts: dict[str, Panel] = {}
        with tabs.add_tab("Guide"):
            for name, build in GUIDES:
                self._guides[name] = gui.add_folder(name, visible=name == PRESETS[0])
                with self._guides[name]:
                    self.parts[name] = build(host)
        for name, build in TABS:
            with tabs.add_tab(name):
                self.parts[name] = build(host)

    def update(self, moment: Moment) -> None:
        """Show progress, the drive's state, and the guide of the preset."""
        own = "" if self._host.shared else "\n\n*exploring on your own*"
        self._drive.content = drive_line(moment) + own
        self._progress.value = 100.0 * moment.snapshot.progress
        self._progress.visible = not moment.snapshot.done
        self._chosen.content = chosen(PRESETS.index(moment.settings.preset))
        for name, folder in self._guides.items():
            folder.visible = name == moment.settings.preset
        for part in self.parts.values():
            part.update(moment)
