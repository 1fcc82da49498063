"""Some seconds of the campaign against the page; `make campaign` is the whole of it."""

from __future__ import annotations

import pytest
from campaign.wire import rows, table


@pytest.mark.wall_clock
def test_a_short_campaign_finds_nothing_wrong() -> None:
    found = rows(messages=60, again=20, at_once=600, seconds=6.0)
    assert not any(row.wrong for row in found), table(found)
