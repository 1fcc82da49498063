"""Teach: a walk through the method; each step sets the view, shows its equation, and can be broken and mended."""

from __future__ import annotations

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.settings import Corrections
from stereocalib_app.words import lessons
from stereocalib_app.words.lessons import LESSONS


class TeachPanel:
    """A folder of the guide tab."""

    def __init__(self, host: Host) -> None:
        self._host = host
        gui = host.gui
        titles = tuple(f"{i + 1} {lesson.title}" for i, lesson in enumerate(LESSONS))
        self._titles = titles
        self._step = gui.add_dropdown("Step", titles, initial_value=titles[0])
        self._move = gui.add_button_group("", ("◀ back", "next ▶"))
        self._words = gui.add_markdown("")
        self._equation = gui.add_html("")
        self._break = gui.add_button("Break it", hint="Breaks this step on purpose.")
        self._mend = gui.add_button("Mend it", hint="Everything back as measured.", visible=False)
        self._effect = gui.add_markdown("")
        host.on_input(self._step, lambda value: self.go(titles.index(value)))
        host.on_click(
            self._move, lambda value: self.go(host.settings.teach_step + (1 if "next" in value else -1))
        )
        host.on_click(self._break, lambda _: self.break_it())
        host.on_click(self._mend, lambda _: self.mend())

    def go(self, step: int) -> None:
        """Show a step, with everything mended."""
        step = step % len(LESSONS)
        self._host.change(
            teach_step=step, layout=LESSONS[step].layout, corrections=Corrections(), broken_stage=""
        )

    def break_it(self) -> None:
        """Break what this step is about."""
        breakage = LESSONS[self._host.settings.teach_step].breakage
        self._host.change(corrections=lessons.broken_corrections(breakage), broken_stage=breakage.stages)

    def mend(self) -> None:
        """Mend it again."""
        self._host.change(corrections=Corrections(), broken_stage="")

    def update(self, moment: Moment) -> None:
        """Show the step."""
        if not moment.settings_changed:
            return
        settings = moment.settings
        lesson = LESSONS[settings.teach_step]
        self._step.value = self._titles[settings.teach_step]
        self._words.content = (
            f"**Step {settings.teach_step + 1} of {len(LESSONS)}: {lesson.title}**\n\n{lesson.words}"
        )
        self._equation.content = lessons.equation_html(lesson.latex)
        self._break.label = f"Break it: {lesson.breakage.label[0].lower()}{lesson.breakage.label[1:]}"
        broken = bool(settings.broken_stage) or settings.corrections.touched
        self._break.visible, self._mend.visible = not broken, broken
        self._effect.content = f"**Broken:** {lesson.breakage.effect}." if broken else ""
