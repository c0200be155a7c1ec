"""Find a board in a picture of a video, quickly enough for every frame; its full precision comes later."""

from __future__ import annotations

import cv2
import numpy as np

from stereo_gpu.boards.board import Board, BoardView
from stereo_gpu.types import Bytes, Floats

SQUARE_PX = 64  # of the shrunk picture's width for each square of the board, within these limits
SIDES = (640, 1280)
MARKED_SIDE = 960  # markers are smaller than squares; 40 ms a picture
PATIENCE = 8  # looks without a find after which the slow finder has a try
SLOW_SIDE = 480


class QuickFinder:
    """Looks for one board in the pictures of one camera.

    Checkerboards: OpenCV's classic finder with its quick check, 3 to 11 ms a picture of 640 x 480, which found all of
    26 real boards at this size. Where it finds nothing for a while, the sector-based finder (20 to 150 ms) tries now
    and then, and keeps the job as long as it succeeds. A board with markers finds itself.
    """

    def __init__(self, board: Board) -> None:
        self._board = board
        self._marked = len(board.turns) == 1  # nothing but markers tells one end of a board from the other
        wanted = SQUARE_PX * max(board.columns, board.rows)
        self._side = MARKED_SIDE if self._marked else int(np.clip(wanted, *SIDES))
        self._misses = 0
        self._slow = False

    def find(self, flat: Bytes) -> BoardView | None:
        """The board in a picture (H, W) uint8, to about half a pixel of the shrunk one; None where it is not seen."""
        if self._marked:
            small = shrink(flat, self._side)
            view = self._board.find(small)
            return None if view is None else BoardView(enlarge(view.corners, small, flat), view.ids)
        corners = self._classic(flat) if not self._slow else self._sectors(flat)
        if corners is None and not self._slow and self._misses % PATIENCE == PATIENCE - 1:
            corners = self._sectors(flat)
            self._slow = corners is not None
        elif corners is None:
            self._slow = False
        self._misses = 0 if corners is not None else self._misses + 1
        return None if corners is None else BoardView.whole(corners)

    def _classic(self, flat: Bytes) -> Floats | None:
        small = shrink(flat, self._side)
        # Adaptive thresholds found no more of the real boards, and took three times as long where only a part is seen.
        flags = cv2.CALIB_CB_FAST_CHECK | cv2.CALIB_CB_NORMALIZE_IMAGE
        found, corners = cv2.findChessboardCorners(small, self._board.corners, flags=flags)
        return enlarge(corners.reshape(-1, 2), small, flat) if found else None

    def _sectors(self, flat: Bytes) -> Floats | None:
        small = shrink(flat, SLOW_SIDE)
        found, corners = cv2.findChessboardCornersSB(small, self._board.corners, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
        return enlarge(corners.reshape(-1, 2), small, flat) if found else None


def shrink(flat: Bytes, side: int) -> Bytes:
    """The picture with `side` px on its longer side, or as it is if that is no more."""
    scale = side / max(flat.shape)
    small: Bytes = cv2.resize(flat, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else flat
    return small


def enlarge(corners: Floats, small: Bytes, whole: Bytes) -> Floats:
    """Places (n, 2) in the shrunk picture as places in the whole one; pixel centres are whole numbers."""
    scale = np.array([whole.shape[1] / small.shape[1], whole.shape[0] / small.shape[0]])
    return np.asarray((corners + 0.5) * scale - 0.5, np.float32)
