"""What a page puts off until its pictures move, and that it does not put it off for ever."""

from __future__ import annotations

from stereocalib_app.drive import debut
from stereocalib_app.drive.debut import Debut


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_pictures_that_move_end_it() -> None:
    page = Debut(False, Clock())
    assert page.enough(debut.FIRST_FRAMES)
    for frame in (0, 0):
        page.drawn(frame)
        assert not page.over
    page.drawn(3)
    assert page.over
    assert not page.enough(10_000)


def test_a_page_that_stands_still_is_not_waited_for() -> None:
    clock = Clock()
    page = Debut(False, clock)
    page.drawn(7)
    assert not page.over
    clock.now_s += 1.1 * debut.STILL_S
    assert page.over


def test_nor_is_a_browser_that_says_nothing() -> None:
    clock = Clock()
    page = Debut(False, clock)
    clock.now_s += 0.9 * debut.LONGEST_S
    assert not page.over
    clock.now_s += 0.2 * debut.LONGEST_S
    assert page.over


def test_where_nobody_waits_nothing_is_put_off() -> None:
    assert Debut(True).over
    assert not Debut(True).enough(10_000)
