"""What docs/extending.md says of the page, run as it stands there."""

from __future__ import annotations

import re
import sys
import types
from pathlib import Path
from typing import Any

import pytest
from conftest import start_page, stop_page, tab, until, warm_page
from stereocalib_app.drive.panels import plots, table

DOC = Path(__file__).resolve().parents[2] / "docs" / "extending.md"


def blocks(of: str) -> list[str]:
    """The Python blocks of the document that are headed by a file's name."""
    return re.findall(rf'```python title="{re.escape(of)}"\n(.*?)```', DOC.read_text(), re.DOTALL)


@pytest.mark.browser
def test_a_plot_is_one_file_and_one_line(
    browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = "app/stereocalib_app/drive/panels"
    (code,), (row,) = blocks(f"{folder}/support.py"), blocks(f"{folder}/table.py")
    module = types.ModuleType("support")
    monkeypatch.setitem(sys.modules, "support", module)
    exec(compile(code, "support.py", "exec"), module.__dict__)
    names = {**vars(table), "SupportPanel": module.SupportPanel}  # type: ignore[attr-defined]
    exec(row, names)
    assert names["PLOTS"][:-1] == table.PLOTS, "the document shows another table than the page has"
    monkeypatch.setattr(plots, "PLOTS", names["PLOTS"])
    hub = start_page("synthetic:plane?frames=5", tmp_path)
    try:
        assert hub.shared.session.wait(60.0)
        page = warm_page(browser, hub)
        tab(page, "Support")
        until(lambda: page.locator(".uplot").count(), what="plot")
        panel = hub.shared.parts["Support"]
        wanted = [r.inliers for r in hub.shared.session.snapshot.results]
        until(lambda: panel._plot.chart.curves[0].values[:5].tolist() == wanted, what="its values")
        page.close()
    finally:
        stop_page(hub)
