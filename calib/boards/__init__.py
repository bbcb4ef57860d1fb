"""Calibration boards: what is known of them, and how they are found in photographs."""

from calib.boards.protocol import Board, Corners
from calib.boards.tables import BOARDS, board_named

__all__ = ["BOARDS", "Board", "Corners", "board_named"]
