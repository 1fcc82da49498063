"""Patience and stores of a run: what is waited for, tried again, read ahead and packed. They change no result."""

from __future__ import annotations

PREPARED_AHEAD = 2
"""So many frames can be prepared while one is looked at: two cores are busy when one frame takes longer than others,
and the road that tells where to match is three frames old."""
READ_AHEAD = 4
"""Frames read beyond those that are being prepared: a disk that falters for a moment keeps nobody waiting."""
MOST_MENDINGS = 2
"""Runs after the first with --self-calibrate: one for the rows where these hide the yaw, one for all."""
RETRIES = 2
"""Of a drive whose worker died: once for a machine that restarts, once more for the one it lands on next."""
CONNECT_TIMEOUT_S, CLOSE_TIMEOUT_S, HURRY_S = 10, 10.0, 0.4
"""For a scheduler that answers; for its workers to end; the same after Ctrl-C, so that the prompt is back at once."""
SYNC_S = 1.0
"""Between two waits for the disk: some milliseconds each, too much for every frame."""
MOST_BYTES_OF_A_RECORD = 64 << 20
"""Of one frame in frames.bin: a thousand times the largest written."""
PICTURE_QUALITY, DISPARITY_QUALITY = 70, 75
"""Of the JPEGs in a recording, of 100: no seam of the 8 px blocks is seen at twice their size."""
VIEWER_TIMEOUT_S, VIEWER_SETTLE_S, FLUSH_TIMEOUT_S = 10.0, 2.0, 30.0
"""For Rerun's viewer to listen, to end if it has no display, and to take what is still on its way."""
