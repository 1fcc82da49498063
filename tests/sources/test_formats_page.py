"""docs/formats.md: every tree on it is what the format looks like, and every command on it opens it."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from sources.laid_out import LAYOUTS, drive_of

from stereocalib_core.sources import open_source
from stereocalib_core.sources.formats.synthetic import SyntheticSource

REPO = Path(__file__).resolve().parents[2]


PAGE = (REPO / "docs" / "formats.md").read_text(encoding="utf-8")
SECTIONS = {
    match.group(1): match.group(2)
    for match in re.finditer(r"^## (.+?)\n(.*?)(?=^#{1,2} |\Z)", PAGE, re.MULTILINE | re.DOTALL)
}


def tree_of(section: str) -> set[str]:
    """The files that a tree names; those that stand for many without their `...`."""
    match = re.search(r"```tree\n(.*?)```", section, re.DOTALL)
    assert match is not None
    found: set[str] = set()
    above: list[tuple[int, str]] = []
    for line in match.group(1).splitlines():
        depth = len(line) - len(line.lstrip())
        above = [(d, name) for d, name in above if d < depth]
        name = line.strip().removesuffix("...").strip()
        path = "".join(part for _, part in above) + name
        if name.endswith("/"):
            above.append((depth, name))
        else:
            found.add(path)
    return found


def test_every_format_has_its_section() -> None:
    assert list(SECTIONS) == list(LAYOUTS)


@pytest.mark.parametrize("name", list(LAYOUTS))
def test_the_tree_and_the_command_of(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if "bag" in name or "MCAP" in name:
        pytest.importorskip("rosbags")
    drive = drive_of(SyntheticSource.from_spec("synthetic:plane?frames=3"), 3)
    spec = LAYOUTS[name].write(tmp_path, drive)
    files = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    tree = tree_of(SECTIONS[name])
    assert tree <= files
    # what the tree does not name is more of the same: the next numbers of a file that it does
    kinds = {re.sub(r"\d+", "#", path) for path in tree}
    assert {path for path in files if re.sub(r"\d+", "#", path) not in kinds} == set()
    command = re.search(r"```sh\n(.*?)\n```", SECTIONS[name], re.DOTALL)
    assert command is not None
    words = shlex.split(command.group(1))
    assert words[:2] == ["stereocalib", "run"] and words[3:] == ["--out", "out"]
    monkeypatch.chdir(tmp_path)
    source = open_source(words[2])
    assert len(source) == 3
    assert source[0].failure is None
    assert open_source(spec).content_key == source.content_key
