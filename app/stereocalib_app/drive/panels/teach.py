"""Teach: a walk through the method; each step sets the view, shows its equation, and can be broken and mended."""

from __future__ import annotations

import random

import numpy as np

from stereocalib_app.drive.moment import Moment
from stereocalib_app.drive.panel import Host
from stereocalib_app.drive.panels.bend import BendLesson
from stereocalib_app.drive.settings import Corrections
from stereocalib_app.widgets import text
from stereocalib_app.words import lessons
from stereocalib_app.words.lessons import LESSONS

UNDECIDED = "not decided"


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
        self._kept: Corrections | None = None
        """What the user had set before something was broken; it comes back."""
        self._bend = BendLesson(host, self._bend_by)
        with gui.add_folder("Quiz", expand_by_default=False):
            gui.add_markdown(
                "The page breaks one step without saying which. Look at pictures, plots and path: which?"
            )
            self._ask = gui.add_button("Break something")
            self._guess = gui.add_dropdown("It is", (UNDECIDED, *(lesson.title for lesson in LESSONS)))
            self._answer = gui.add_markdown("")
        self._secret: int | None = None
        host.on_input(self._step, lambda value: self.go(titles.index(value)))
        host.on_click(
            self._move, lambda value: self.go(host.settings.teach_step + (1 if "next" in value else -1))
        )
        host.on_click(self._break, lambda _: self.break_it())
        host.on_click(self._mend, lambda _: self.mend())
        host.on_click(self._ask, lambda _: self.quiz(random.randrange(len(LESSONS))))
        host.on_input(self._guess, self.guess)

    def _restored(self) -> Corrections:
        kept, self._kept = self._kept, None
        self._secret = None
        return self._host.settings.corrections if kept is None else kept

    def go(self, step: int) -> None:
        """Show a step, with everything mended and the user's own corrections back."""
        step = step % len(LESSONS)
        self._host.change(
            teach_step=step, layout=LESSONS[step].layout, corrections=self._restored(), broken_stage=""
        )

    def break_it(self) -> None:
        """Break what this step is about."""
        step = self._host.settings.teach_step
        self._break_step(step)
        if LESSONS[step].breakage.stages in lessons.TURNED:
            self._bend.measure(lessons.TURN_DEG)

    def _break_step(self, step: int) -> None:
        breakage = LESSONS[step].breakage
        if self._kept is None:
            self._kept = self._host.settings.corrections
        self._host.change(corrections=lessons.broken_corrections(breakage), broken_stage=breakage.stages)

    def _bend_by(self, bend_deg: float) -> None:
        """The pictures of a pair that is bent by so much."""
        if bend_deg and self._kept is None:
            self._kept = self._host.settings.corrections
        corrections = self._host.settings.corrections if bend_deg else self._restored()
        self._host.change(broken_stage=lessons.turned_stage(bend_deg), corrections=corrections)

    def mend(self) -> None:
        """Mend it again, and give back what the user had set."""
        was_bent = self._host.settings.broken_stage in lessons.TURNED
        self._host.change(corrections=self._restored(), broken_stage="")
        if was_bent:
            self._bend.measure(0.0)

    def quiz(self, step: int) -> None:
        """Break one step without saying which."""
        self._break_step(step)
        self._secret = step
        self._answer.content = "Something is broken. Which step is it?"

    def guess(self, title: str) -> None:
        """Say whether the class has found it. Steps that are broken alike count alike."""
        if self._secret is None or title == UNDECIDED:
            return
        wanted, given = LESSONS[self._secret], next(lesson for lesson in LESSONS if lesson.title == title)
        alike = (wanted.breakage.stages, wanted.breakage.corrections) == (
            given.breakage.stages,
            given.breakage.corrections,
        )
        if not alike:
            self._answer.content = f"Not {text.escape(title)}. Look again."
            return
        found = f"**Found: {text.escape(title)}.** {text.escape(wanted.breakage.effect)}."
        self.mend()
        self._answer.content = found

    def update(self, moment: Moment) -> None:
        """Show the step."""
        settings = moment.settings
        lesson = LESSONS[settings.teach_step]
        turned_by = lessons.TURNED.get(settings.broken_stage, 0.0) if self._secret is None else 0.0
        is_bend = lesson.breakage.stages in lessons.TURNED
        self._bend.update(moment, is_bend, round(float(np.rad2deg(turned_by)), 2))
        if not moment.settings_changed:
            return
        self._step.value = self._titles[settings.teach_step]
        self._words.content = (
            f"**Step {settings.teach_step + 1} of {len(LESSONS)}: {lesson.title}**\n\n{lesson.words}"
        )
        self._equation.content = lessons.equation_html(lesson.latex)
        self._break.label = f"Break it: {lesson.breakage.label[0].lower()}{lesson.breakage.label[1:]}"
        broken = bool(settings.broken_stage) or self._kept is not None
        self._break.visible, self._mend.visible = not broken, broken
        told = broken and self._secret is None
        self._effect.content = f"**Broken:** {lesson.breakage.effect}." if told else ""
