"""Axes of a panel show what matplotlib's own axes show."""

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from truearm.pages.plotting import Figure, PanelAxes, figure_style, make_panel, pixels_of, set_log_scale

PLACE = (0.2, 0.2, 0.75, 0.7)


def _linear(axes):
    axes.plot([0, 3.3], [-1, 2])
    axes.set(xlabel="error [mm]", ylabel="readings", xlim=(0, 3))


def _reversed_logarithmic(axes):
    axes.plot([1, 1000], [5, 3])
    set_log_scale(axes, "x", 0.9, 1200)
    axes.set_ylim(6, 2)


def _offset(axes):
    axes.plot([1e6 + 1, 1e6 + 2], [1e-9, 2e-9])


def _own_ticks(axes):
    axes.set_xticks([0, 1], ["first\ncheck", "last"])
    axes.get_xticklabels()[0].set_horizontalalignment("left")
    axes.set_yticks([])
    axes.minorticks_on()


def _hidden(axes):
    axes.yaxis.set_visible(False)
    axes.tick_params(axis="x", length=0, labelbottom=False)


@pytest.mark.parametrize("draw", [_linear, _reversed_logarithmic, _offset, _own_ticks, _hidden])
def test_ticks_are_where_matplotlib_draws_them(draw):
    pictures = []
    for kind in (Axes, PanelAxes):
        with figure_style():
            drawing = Drawing(figsize=(3, 2))
            axes = kind(drawing, PLACE)
            drawing.add_axes(axes)
            PanelAxes.place_labels(axes, left_in=0.11, bottom_in=0.17)
            draw(axes)
        pictures.append(pixels_of(Figure((drawing,), "caption", "alt")))
    assert np.array_equal(*pictures)


def test_a_saved_figure_has_all_panels_on_one_sheet_and_room_for_their_labels(tmp_path):
    figure = Figure((panel(0.01), panel(3000.0), panel(-0.0005)), "caption", "alt", columns=2)
    figure.save(tmp_path / "figure.pdf")
    content = (tmp_path / "figure.pdf").read_bytes()
    assert content.count(b"/Type /Page\n") + content.count(b"/Type /Page ") == 1
    figure.save(tmp_path / "again.pdf")
    assert (tmp_path / "again.pdf").read_bytes() == content
    picture = pixels_of(figure)
    # Nothing is cut off: the outermost pixels of the left edge are paper.
    assert (picture[:, :2] == 255).all()


def panel(top):
    with figure_style():
        drawing, (axes,) = make_panel(4.6, 2.0)
        axes.plot([0, 1], [0, top])
        axes.set(xlabel="reading", ylabel="share of readings [%]")
    return drawing
