"""`draw_board`: a board as a PDF to scale, with rulers along both sides by which a print is checked."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.verbs.record import Record
from truearm.wings.camera.boards import Board, named_board
from truearm.wings.camera.patterns import Pattern, pattern_of

PaperSize = Literal["a4", "a3", "a2", "a1", "a0", "letter", "tabloid"]
# Shorter and longer side [mm].
PAPERS: dict[str, tuple[float, float]] = {
    "a4": (210.0, 297.0),
    "a3": (297.0, 420.0),
    "a2": (420.0, 594.0),
    "a1": (594.0, 841.0),
    "a0": (841.0, 1189.0),
    "letter": (215.9, 279.4),
    "tabloid": (279.4, 431.8),
}
# What printers leave white, and the room of a ruler with its text [mm].
EDGE_MM, RULER_MM = 8.0, 12.0
INCH_MM = 25.4


@dataclass(frozen=True, eq=False, repr=False)
class BoardSheet(Record):
    """A board on a sheet of paper.

    Attributes
    ----------
    board : Board
    paper : str
        Name of the paper's size.
    width_mm, height_mm : float
        Of the sheet.

    Examples
    --------
    >>> import truearm as ta
    >>> sheet = ta.draw_board("chessboard:9x6,25mm")
    >>> print(sheet.summary())
    Board chessboard:9x6,25mm with 54 corners, 250 x 175 mm on A4.
    >>> sheet.save("board.pdf")
    """

    board: Board
    paper: str
    width_mm: float
    height_mm: float
    pattern: Pattern

    @property
    def rulers_mm(self) -> tuple[int, int]:
        """Lengths of the rulers along the width and the height [mm]: whole centimetres."""
        width, height = (max(int(size // 10) * 10, 10) for size in self.pattern.size_mm)
        return width, height

    def save(self, path: str | Path) -> None:
        """Write the sheet as PDF; the file appears whole or not at all.

        Raises
        ------
        InputError
            If the name does not end in .pdf, or the file cannot be written.
        """
        if Path(path).suffix.lower() != ".pdf":
            raise InputError(f"expected a file name that ends in .pdf, got {Path(path).name!r}", file=path)
        with atomic_file(path) as part:
            self._write(part)

    def summary(self) -> str:
        """The answer in one sentence: which board on which paper."""
        width, height = self.pattern.size_mm
        name = self.paper.upper() if self.paper.startswith("a") else self.paper
        return f"Board {self.board.name} with {len(self.board)} corners, {width:g} x {height:g} mm on {name}."

    def blocks(self) -> Iterator[str]:
        """See `Record.blocks`."""
        yield self.summary()
        across, along = self.rulers_mm
        yield (
            f"Print it at 100 % (no fit to page) and glue it on something flat. Then measure the rulers: {across} mm "
            f"and {along} mm."
        )
        yield (
            f"Unmeasured, a print's size has a standard uncertainty of {100 * self.board.u_scale:g} %; measured, state "
            "the sides as they are and u=0.05% behind them."
        )

    def _json(self) -> object:
        return {
            "summary": self.summary(),
            "board": self.board.name,
            "corners": len(self.board),
            "size_mm": self.pattern.size_mm,
            **self._named("paper", "width_mm", "height_mm", "rulers_mm"),
        }

    def _write(self, path: Path) -> None:
        from matplotlib import rc_context
        from matplotlib.figure import Figure as Drawing
        from matplotlib.patches import PathPatch
        from matplotlib.path import Path as Outline

        size = self.width_mm, self.height_mm
        drawing = Drawing(figsize=(size[0] / INCH_MM, size[1] / INCH_MM))
        axes = drawing.add_axes((0, 0, 1, 1), xlim=(0, size[0]), ylim=(size[1], 0))
        axes.set_axis_off()
        left, top = self._corner
        # One outline of all rectangles: drawn one by one, their common edges would show as hairlines.
        x0, y0, x1, y1 = (self.pattern.rectangles + [left, top, left, top]).T
        corners = np.stack([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]).transpose(2, 0, 1).reshape(-1, 2)
        codes = [Outline.MOVETO, Outline.LINETO, Outline.LINETO, Outline.LINETO, Outline.CLOSEPOLY] * len(x0)
        axes.add_patch(PathPatch(Outline(corners, codes), facecolor="black", linewidth=0))
        self._draw_rulers(axes, left, top)
        undated = {"CreationDate": None, "Creator": None, "Producer": None, "Title": self.board.name}
        with rc_context({"pdf.fonttype": 42, "font.family": "DejaVu Sans"}):
            drawing.savefig(path, format="pdf", metadata=undated)

    @property
    def _corner(self) -> tuple[float, float]:
        """Where the pattern's upper left corner is on the sheet: in the middle of what the rulers leave [mm]."""
        width, height = self.pattern.size_mm
        return (self.width_mm - width + RULER_MM) / 2, (self.height_mm - height - RULER_MM) / 2

    def _draw_rulers(self, axes: object, left: float, top: float) -> None:
        """Rulers in mm below and to the left of the pattern, half their room from it."""
        from matplotlib.axes import Axes

        assert isinstance(axes, Axes)
        below, beside = top + self.pattern.size_mm[1] + RULER_MM / 3, left - RULER_MM / 3
        for axis, length in enumerate(self.rulers_mm):
            places = np.arange(length + 1.0)
            tick = np.where(places % 10 == 0, 4.0, np.where(places % 5 == 0, 3.0, 2.0))
            lines = [[[left + s, below], [left + s, below + t]] for s, t in zip(places, tick, strict=True)]
            if axis == 1:
                lines = [[[beside, top + s], [beside - t, top + s]] for s, t in zip(places, tick, strict=True)]
            for line in lines:
                axes.plot(*np.transpose(line), color="black", linewidth=0.1 * 72 / INCH_MM, solid_capstyle="butt")
        across, along = self.rulers_mm
        text = f"{self.board.name}   rulers: {across} mm, {along} mm; print at 100 %   truearm"
        axes.text(left, below + 5.0, text, fontsize=6, va="top", ha="left", parse_math=False)


def draw_board(board: str | Board, *, paper: PaperSize | None = None) -> BoardSheet:
    """Draw a board to scale, with rulers along both sides.

    Parameters
    ----------
    board : str
        Its text, as ``charuco:8x11,15mm,11mm``, ``chessboard:9x6,25mm`` or ``aprilgrid:6x6,24mm,7.2mm``.
    paper : {"a4", "a3", "a2", "a1", "a0", "letter", "tabloid"}, optional
        Size of the paper; the smallest of A4 to A0 that holds it by default.

    Returns
    -------
    BoardSheet

    Raises
    ------
    InputError
        If the text is no board, the board is a list of points, or the paper is too small.

    Examples
    --------
    >>> import truearm as ta
    >>> ta.draw_board("chessboard:9x6,25mm").rulers_mm
    (250, 170)
    """
    board = named_board(board) if isinstance(board, str) else board
    if paper is not None and paper not in get_args(PaperSize):
        raise InputError(f"expected a paper size out of {', '.join(PAPERS)}, got {paper!r}")
    pattern = pattern_of(board)
    needed = [size + 2 * EDGE_MM + RULER_MM for size in pattern.size_mm]
    for name in (paper,) if paper else ("a4", "a3", "a2", "a1", "a0"):
        sides = PAPERS[name]
        sheet = sides if pattern.size_mm[0] <= pattern.size_mm[1] else sides[::-1]
        if needed[0] <= sheet[0] and needed[1] <= sheet[1]:
            return BoardSheet(board, name, *sheet, pattern)
    width, height = pattern.size_mm
    raise InputError(
        f"the board is {width:g} x {height:g} mm, with its rulers and edges too large for {(paper or 'a0').upper()}",
        hint="smaller squares, or fewer",
    )
