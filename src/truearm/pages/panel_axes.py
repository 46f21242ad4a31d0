"""Axes of a panel: matplotlib's own, but one tick is drawn at every place of its axis.

matplotlib makes five objects for each tick and lays out its label three times, which takes a quarter of the time of a
page.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis, YAxis
from matplotlib.backend_bases import RendererBase
from matplotlib.ticker import NullLocator
from matplotlib.transforms import blended_transform_factory

from truearm.typing import FloatArray


class PanelAxes(Axes):
    """Axes with one tick on each axis."""

    def _init_axis(self) -> None:
        self.xaxis, self.yaxis = _PanelXAxis(self), _PanelYAxis(self)
        for side in ("bottom", "top"):
            self.spines[side].register_axis(self.xaxis)
        for side in ("left", "right"):
            self.spines[side].register_axis(self.yaxis)

    def place_labels(self, *, left_in: float, bottom_in: float) -> None:
        """Set the labels of the axes at fixed distances from the left and the lower edge of the drawing [inch].

        The labels of neighbouring panels are then aligned however long the numbers are.
        """
        drawing = self.get_figure()
        assert drawing is not None
        inches = drawing.dpi_scale_trans
        self.xaxis.set_label_coords(0.5, bottom_in, transform=blended_transform_factory(self.transAxes, inches))
        self.yaxis.set_label_coords(left_in, 0.5, transform=blended_transform_factory(inches, self.transAxes))


class _PanelAxis(Axis):
    axis_name: str

    def reset_ticks(self) -> None:
        super().reset_ticks()
        self.minorTicks: list[Any] = []  # otherwise matplotlib makes the first one, which no panel shows

    def draw(self, renderer: RendererBase) -> None:
        if not self.get_visible():
            return
        places = np.asarray(self.get_majorticklocs(), dtype=np.float64)
        formatter = self.get_major_formatter()
        texts = formatter.format_ticks(list(places))
        # A figure that styles its ticks one by one, or shows others than these, has them drawn one by one.
        if len(self.majorTicks) > 1 or not isinstance(self.get_minor_locator(), NullLocator) or formatter.get_offset():
            super().draw(renderer)
            return
        along = self.get_transform().transform(places)
        low, high = np.sort(self.get_transform().transform(np.asarray(self.get_view_interval())))
        margin = 1e-10 * (high - low)  # a tick at the end of the axis is drawn although it is rounded
        shown = np.flatnonzero((along >= low - margin) & (along <= high + margin))
        if shown.size:
            self._draw_ticks(places[shown], [texts[i] for i in shown], renderer)
        self.label.draw(renderer)
        self.stale = False

    def _draw_ticks(self, places: FloatArray, texts: list[str], renderer: RendererBase) -> None:
        """Draw the grid as one line with gaps, the marks as markers of one line, and the labels one by one."""
        (tick,) = self.majorTicks
        n, horizontal = len(places), self.axis_name == "x"
        for line, across in ((tick.gridline, (0.0, 1.0, np.nan)), (tick.tick1line, (0.0,)), (tick.tick2line, (1.0,))):
            if line.get_visible():
                points = np.repeat(places, len(across)), np.tile(across, n)
                line.set_data(*points if horizontal else points[::-1])
                line.draw(renderer)
        for label in (tick.label1, tick.label2):
            if label.get_visible():
                for place, text in zip(places, texts, strict=True):
                    (label.set_x if horizontal else label.set_y)(place)
                    label.set_text(text)
                    label.draw(renderer)


class _PanelXAxis(_PanelAxis, XAxis):
    pass


class _PanelYAxis(_PanelAxis, YAxis):
    pass
