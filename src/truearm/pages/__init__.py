"""Self-contained HTML pages: rows, tables and figures of arrays."""

from typing import Literal

FigureFormat = Literal["svg", "pdf", "png"]
