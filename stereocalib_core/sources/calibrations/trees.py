"""Calibration files of every syntax to plain values: YAML, OpenCV's YAML, JSON and XML, `KEY: numbers` lines."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from stereocalib_core.config.reading import MOST_BYTES_OF_A_CALIBRATION
from stereocalib_core.errors import SourceError
from stereocalib_core.geometry import Array
from stereocalib_core.system.text_file import read_text, to_number, to_numbers
from stereocalib_core.system.yaml_file import parse_plain

Tree = dict[str, Any]
_LINE = re.compile(r"^\s*([A-Za-z][\w .\-]*?)\s*[:=]\s*(.*?)\s*$")
_MATRIX = re.compile(r"!!?opencv-(?:nd-)?matrix|!<tag:yaml.org,2002:opencv-(?:nd-)?matrix>")
_TIGHT = re.compile(r"^(\s*[\w.]+:)(?=\[)", re.MULTILINE)
"""`data:[1, 2]`, which OpenCV reads and YAML does not."""
_MANY_NUMBERS = 9


def read_tree(path: Path) -> Tree:
    """The top level of a calibration file as a mapping; raises SourceError in one line."""
    return parse_tree(read_text(path, MOST_BYTES_OF_A_CALIBRATION, "calibration"), path)


def parse_tree(text: str, path: Path) -> Tree:
    """As `read_tree`, from its text."""
    start = text.lstrip()
    if start.startswith("<"):
        return _xml(start, path)
    lines = _number_lines(text)
    if lines is not None:
        return lines
    if start.startswith("%YAML"):
        text = start.partition("\n")[2]
    try:
        values = parse_plain(_TIGHT.sub(r"\1 ", _MATRIX.sub("", text)))
    except (yaml.YAMLError, ValueError, RecursionError) as reason:
        line = " ".join(str(reason).split())[:200] or "check its syntax"
        raise SourceError("calibration neither YAML nor JSON", path, line) from reason
    if not isinstance(values, dict):
        raise SourceError("calibration has no keys", path, "write one `key: value` per line")
    return {str(key): value for key, value in values.items()}


def _number_lines(text: str) -> Tree | None:
    """`KEY: n n n ...` lines as in KITTI and Middlebury; None where the text is none of these."""
    found: Tree = {}
    longest = 0
    for line in text.splitlines():
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        match = _LINE.match(line)
        if match is None:
            return None
        key, rest = match.groups()
        if rest.startswith(("{", "!!")) or not rest and not key.startswith(("P", "R", "T")):
            return None
        values = to_numbers(rest)
        if values is not None and ("," not in rest or " " in rest) and not rest.startswith("[["):
            longest = max(longest, len(values))
        found[key] = rest
    return found if longest >= _MANY_NUMBERS else None


def _xml(text: str, path: Path) -> Tree:
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise SourceError("calibration with entities", path, "write plain XML as OpenCV does")
    try:
        root = ElementTree.fromstring(re.sub(r"^<\?xml[^>]*\?>", "", text))
    except (ElementTree.ParseError, ValueError, RecursionError) as reason:
        raise SourceError("calibration is no XML", path, str(reason)[:200]) from reason
    value = _element(root, 0)
    if not isinstance(value, dict):
        raise SourceError("calibration has no keys", path, "expected OpenCV's <opencv_storage>")
    return value


def _element(element: ElementTree.Element, depth: int) -> Any:
    if depth > 20 or len(element) == 0:
        return (element.text or "").strip()
    if all(child.tag == "_" for child in element):
        return [_element(child, depth + 1) for child in element]
    return {child.tag: _element(child, depth + 1) for child in element}


def key_of(tree: Any, *names: str) -> str | None:
    """The first of `names` that a tree has, whatever its capitals."""
    if not isinstance(tree, dict):
        return None
    present = {str(key).lower(): key for key in tree}
    return next((present[name.lower()] for name in names if name.lower() in present), None)


def array(tree: Any, key: str, sizes: tuple[int, ...], where: object) -> Array:
    """The numbers under `key`, flattened: nested lists, OpenCV's or ROS' {rows, cols, data}, or a text of numbers.

    Raises SourceError where there are none or not as many as one of `sizes`.
    """
    given = numbers_in(tree.get(key) if isinstance(tree, dict) else None)
    if given is None or len(given) not in sizes:
        expected = " or ".join(str(size) for size in sizes)
        raise SourceError(f"{key} is missing or wrong", where, f"expected {expected} finite numbers")
    return np.array(given, dtype=np.float64)


def numbers_in(value: Any) -> list[float] | None:
    """All numbers of a value in their order, None where it holds anything else."""
    if isinstance(value, dict):
        return numbers_in(value.get("data"))
    if isinstance(value, str):
        return to_numbers(value)
    if not isinstance(value, (list, tuple)):
        number = to_number(value)
        return None if number is None else [number]
    found: list[float] = []
    for item in value:
        inner = numbers_in(item) if isinstance(item, (list, tuple)) else to_number(item)
        if inner is None:
            return None
        found += inner if isinstance(inner, list) else [inner]
    return found


def number(tree: Tree, key: str, where: object, low: float, high: float, whole: bool = False) -> float:
    """One number from `low` to `high` under `key`; raises SourceError that names it."""
    value = to_number(tree.get(key))
    if value is None:
        raise SourceError(f"{key} is missing or no number", where, f"write `{key}: NUMBER`")
    if not low <= value <= high or (whole and value != int(value)):
        kind = "a whole number" if whole else "a number"
        raise SourceError(
            f"{key} is {str(tree[key])[:20]}", where, f"expected {kind} from {low:g} to {high:g}"
        )
    return value
