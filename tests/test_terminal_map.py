"""What stands on a terminal after each look, and what is printed where there is none."""

import io
import re

import moving_boards
import numpy as np
import pytest

from stereo_gpu.boards.coverage import COLUMNS, ROWS
from stereo_gpu.recording.board_watch import Look
from stereo_gpu.recording.terminal_map import TerminalMap

PICTURE = np.zeros((48, 64, 3), np.uint8)


def look(status="hold still", pairs=2, progress=0.5, taken=False, cells=0, missing=(["one", "two"], ["three"])):
    counts = np.full((ROWS, COLUMNS), cells, np.int32)
    counts[0, 0] = 9
    return Look(
        frame=moving_boards.frame(1, (PICTURE, PICTURE)),
        views=(None, None),
        status=status,
        taken=taken,
        pairs=pairs,
        cells=(counts, counts.T.copy().reshape(ROWS, COLUMNS)),
        missing=missing,
        wanted=([], []),
        progress=progress,
        done=False,
    )


class Terminal(io.StringIO):
    """A screen that knows the few codes that the map uses, and refuses all others."""

    encoding = "utf-8"

    def __init__(self):
        super().__init__()
        self.lines, self.row, self.column = [[]], 0, 0
        self.cursor_shown = True

    def isatty(self):
        return True

    def write(self, text):
        for code, sign in re.findall(r"(\x1b\[\??[0-9]*[A-Za-z])|(.|\n)", text, re.DOTALL):
            if code == "\x1b[J":
                del self.lines[self.row + 1 :]
                del self.lines[self.row][self.column :]
            elif code == "\x1b[K":
                del self.lines[self.row][self.column :]
            elif up := re.fullmatch(r"\x1b\[([0-9]+)F", code):
                self.row, self.column = self.row - int(up[1]), 0
                assert self.row >= 0
            elif code in ("\x1b[?25l", "\x1b[?25h"):
                self.cursor_shown = code.endswith("h")
            elif sign == "\r":
                self.column = 0
            elif sign == "\n":
                self.row, self.column = self.row + 1, 0
                if self.row == len(self.lines):
                    self.lines.append([])
            else:
                assert not code and sign.isprintable()
                self.lines[self.row][self.column : self.column + 1] = [sign]
                self.column += 1
        return len(text)

    @property
    def screen(self):
        return ["".join(line) for line in self.lines]


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def wide(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("LINES", "24")
    monkeypatch.setenv("TERM", "xterm")


def test_the_map_is_redrawn_in_place(clock, wide):
    terminal = Terminal()
    with TerminalMap(terminal, clock) as shown:
        shown.show(look())
        first = terminal.screen
        assert first[0] == ""
        assert first[1].split() == ["left", "camera", "right", "camera"]
        assert first[2] == "██" + "··" * 7 + "    " + "██" + "··" * 7
        assert first[3] == "··" * 8 + "    " + "··" * 8
        assert first[8] == "[############............]  50%  2 pairs"
        assert first[9:] == ["hold still", "left: one", "left: two", "right: three"]
        assert not terminal.cursor_shown
        clock.now += 0.05
        shown.show(look(status="too soon to draw"))
        assert terminal.screen == first
        clock.now += 0.2
        shown.show(look(status="taken", pairs=1, cells=2, missing=(["one"], [])))
        assert terminal.screen[8:] == ["[############............]  50%  1 pair", "taken", "left: one"]
        assert terminal.screen[3].startswith("▒▒▒▒")
    assert terminal.cursor_shown
    assert terminal.row == len(terminal.lines) - 1 and terminal.lines[-1] == []  # below the map


def test_other_lines_stay_above_the_map(clock, wide):
    terminal = Terminal()
    with TerminalMap(terminal, clock) as shown:
        for number in range(3):
            clock.now += 1
            shown.show(look())
            terminal.write(f"pair {number}: left.png, right.png\n")
    assert terminal.screen[:3] == [f"pair {number}: left.png, right.png" for number in range(3)]
    assert sum("left camera" in line for line in terminal.screen) == 1


def test_more_than_three_lacks_are_counted(clock, wide):
    terminal = Terminal()
    TerminalMap(terminal, clock).show(look(missing=(["a", "b", "c"], ["d", "b", "e"])))
    assert terminal.screen[-3:] == ["both pictures: b", "left: a", "and 3 more"]


@pytest.mark.parametrize(("columns", "lines"), [("30", "24"), ("80", "8"), ("12", "3")])
def test_a_small_terminal_gets_no_map(clock, wide, monkeypatch, columns, lines):
    monkeypatch.setenv("COLUMNS", columns)
    monkeypatch.setenv("LINES", lines)
    terminal = Terminal()
    TerminalMap(terminal, clock).show(look())
    assert len(terminal.screen) == 3
    assert all(len(line) < int(columns) for line in terminal.screen)
    assert terminal.screen[2] == "hold still"[: int(columns) - 1]


def test_a_terminal_without_unicode_gets_ascii(clock, wide):
    terminal = Terminal()
    terminal.encoding = "ascii"
    TerminalMap(terminal, clock).show(look(cells=1))
    assert terminal.screen[2].startswith("##::::")
    assert all(line.isascii() for line in terminal.screen)


def test_elsewhere_pairs_and_what_lasts_get_a_line(clock):
    stream = io.StringIO()
    with TerminalMap(stream, clock) as shown:
        for step in range(30):  # three seconds, of which the board is sought for one and a half
            clock.now += 0.1
            shown.show(look(status="hold still" if step < 16 else f"passing {step}"))
        shown.show(look(status="taken: now tilt it", taken=True, pairs=3, progress=0.61))
        shown.show(look(status="hold still"))
    assert stream.getvalue().splitlines() == [
        "stereo-gpu: 2 pairs, 50%: hold still",
        "stereo-gpu: 3 pairs, 61%: taken: now tilt it",
    ]


def test_a_dumb_terminal_is_not_drawn_on(clock, wide, monkeypatch):
    monkeypatch.setenv("TERM", "dumb")
    terminal = Terminal()
    with TerminalMap(terminal, clock) as shown:
        shown.show(look(taken=True))
    assert terminal.screen == ["stereo-gpu: 2 pairs, 50%: hold still", ""]
