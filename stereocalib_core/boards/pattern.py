"""Is the pattern in the pictures the one that board.yaml names? Squares are often counted as inner corners."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stereocalib_core.boards.chessboard import shows_pattern
from stereocalib_core.boards.observation import BoardSpec
from stereocalib_core.config.boards_search import CHESSBOARD


def true_pattern(pictures: Sequence[NDArray[np.uint8]], board: BoardSpec) -> tuple[BoardSpec, str]:
    """The board with the pattern that a few grey pictures show, and a sentence where it is another one; else ("").

    A quick look: only when no picture shows the named pattern, and most of them the same other one.
    """
    if not pictures or any(shows_pattern(p, (board.columns, board.rows)) for p in pictures):
        return board, ""
    for columns, rows in _mistakes(board):
        seen = sum(shows_pattern(p, (columns, rows)) for p in pictures)
        if seen >= max(1, CHESSBOARD.least_agreeing_share * len(pictures)):
            squares = (columns + 1, rows + 1) == (board.columns, board.rows)
            told = "that counts squares: " if squares else ""
            return _with_pattern(board, columns, rows), (
                f"board.yaml says {board.columns}x{board.rows}, {told}the pictures show {columns}x{rows} inner "
                f"corners, which are used; write columns: {columns}, rows: {rows}"
            )
    return board, ""


def _mistakes(board: BoardSpec) -> Iterator[tuple[int, int]]:
    """Other patterns that people mean, the commonest first."""
    for across, down in ((-1, -1), (1, 1), (-1, 0), (0, -1)):
        columns, rows = board.columns + across, board.rows + down
        if min(columns, rows) >= 3:
            yield columns, rows


def _with_pattern(board: BoardSpec, columns: int, rows: int) -> BoardSpec:
    """Sizes that were not given follow the pattern."""
    width = 0.0 if board.width_m == (board.columns + 1) * board.square_m else board.width_m
    height = 0.0 if board.height_m == (board.rows + 1) * board.square_m else board.height_m
    return replace(board, columns=columns, rows=rows, width_m=width, height_m=height)
