"""A town from its file is the town that was painted, to the last bit, and anything else is none."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from stereocalib_core.simulator.settings import DriveSettings, parse_spec
from stereocalib_core.simulator.studio import Studio
from stereocalib_core.sources.formats import kept_world
from stereocalib_core.sources.formats.synthetic import town_version


@pytest.fixture(scope="module")
def painted() -> Studio:
    return Studio(parse_spec("synthetic:plane?frames=2"))


@pytest.fixture
def file(painted: Studio, tmp_path: Path) -> Path:
    path = tmp_path / "sub" / "plane.world"
    kept_world.write_world(path, painted.world)
    return path


def test_pictures_of_it_are_the_same(painted: Studio, file: Path) -> None:
    again = Studio(painted.settings)
    read = kept_world.read_world(file, again.drive)
    assert read is not None
    for part in ("mesh", "atlas"):
        ours, theirs = getattr(read, part), getattr(painted.world, part)
        for field in fields(ours):
            np.testing.assert_array_equal(getattr(ours, field.name), getattr(theirs, field.name))
    again.__dict__["world"] = read
    for ours, theirs in zip(again.pictures(1), painted.pictures(1), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert [p.name for p in file.parent.iterdir()] == [file.name]


@pytest.mark.parametrize(
    "damage", [lambda d: d[:-1], lambda d: b"", lambda d: b"XXXX" + d[4:], lambda d: d[:4]]
)
def test_a_file_that_is_not_whole_is_none(painted: Studio, file: Path, damage: object) -> None:
    file.write_bytes(damage(file.read_bytes()))  # type: ignore[operator]
    assert kept_world.read_world(file, painted.drive) is None
    assert kept_world.read_world(file.with_name("nothing"), painted.drive) is None


@pytest.mark.parametrize(
    ("spec", "is_town"),
    [
        ("synthetic:town", True),
        ("synthetic:town?frames=12", True),
        ("synthetic:town?fault=truck@3-5", True),
        ("synthetic:town?fault=ramp@3-5", False),
        ("synthetic:town?seed=1", False),
        ("synthetic:town?traffic=0", False),
        ("synthetic:curves", False),
    ],
)
def test_whose_world_is_the_town(spec: str, is_town: bool) -> None:
    assert kept_world.is_town(parse_spec(spec)) == is_town
    assert kept_world.is_town(DriveSettings())


def test_the_town_is_kept_where_that_can_be_and_found_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a file").write_text("no folder")
    old = tmp_path / "cache" / "town-before.world"
    old.parent.mkdir()
    old.write_bytes(b"")
    found = [tmp_path / "a file" / "town-v.world", old.with_name("town-v.world")]
    studio = Studio(parse_spec("synthetic:town?frames=3"))
    kept_world.open_town(studio, town_version())
    monkeypatch.setattr(kept_world, "places", lambda version: found)
    kept_world.keep_painted(studio, "v")
    assert [path.is_file() for path in (*found, old)] == [False, True, False]
    longer = Studio(parse_spec("synthetic:town?frames=5"))
    kept_world.open_town(longer, "v")
    assert longer.__dict__["world"].drive is longer.drive
    np.testing.assert_array_equal(longer.world.atlas.texels, studio.world.atlas.texels)
    assert longer.world.standing[3].kind == studio.world.standing[3].kind
