"""The house of the app: no circle of files, modules that can be read, panels that know no page."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import stereocalib_app

import stereocalib_core

APP = Path(stereocalib_app.__file__).parent
NAME = APP.name
LONGEST = 350


def module_name(path: Path) -> str:
    parts = path.relative_to(APP.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in APP.rglob("*.py")}


def imported(path: Path) -> Iterator[str]:
    """The modules of the app that a file names in any import, inside functions and for types only as well."""
    for node in ast.walk(ast.parse(path.read_text())):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names] + [node.module]
        for name in names:
            if name in MODULES and name != NAME:
                yield name


def circles(arrows: dict[str, set[str]]) -> list[list[str]]:
    """Groups of files that can reach each other (Tarjan)."""
    found: list[list[str]] = []
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for following in arrows[name]:
            if following not in index:
                visit(following)
                low[name] = min(low[name], low[following])
            elif following in stack:
                low[name] = min(low[name], index[following])
        if low[name] == index[name]:
            group = stack[stack.index(name) :]
            del stack[stack.index(name) :]
            if len(group) > 1:
                found.append(sorted(group))

    for name in arrows:
        if name not in index:
            visit(name)
    return found


def test_no_circle_of_files() -> None:
    arrows = {name: set(imported(path)) - {name} for name, path in MODULES.items()}
    assert sum(map(len, arrows.values())) > len(MODULES)
    assert circles(arrows) == []


def test_a_circle_is_found() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == [["b", "c"]]


def test_panels_know_no_page() -> None:
    for path in [
        *(APP / "drive" / "panels").glob("*.py"),
        APP / "drive" / "panel.py",
        APP / "boards" / "panels.py",
    ]:
        assert not {name for name in imported(path) if name.endswith(".page")}, path.name


def test_modules_can_be_read() -> None:
    long = {name: n for name, path in MODULES.items() if (n := len(path.read_text().splitlines())) > LONGEST}
    assert long == {}


def test_every_setting_is_read() -> None:
    """A number in `config` that no code asks for says something that is not so."""
    core = Path(stereocalib_core.__file__).parent
    trees = [ast.parse(path.read_text()) for root in (core, APP) for path in root.rglob("*.py")]
    read = {n.attr for tree in trees for n in ast.walk(tree) if isinstance(n, ast.Attribute)}
    fields = [
        (path.name, part.target.id)
        for path in (core / "config").glob("*.py")
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.ClassDef)
        for part in node.body
        if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name)
    ]
    assert len(fields) > 300
    assert [where for where in fields if where[1] not in read] == []
