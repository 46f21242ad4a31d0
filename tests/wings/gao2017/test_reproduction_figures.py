"""Figures of a reproduction: they show the data they are given, and labels do not overlap."""

from itertools import combinations, pairwise

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import Circle, Rectangle

from truearm.arm.rigid_motions import screw_x, screw_z
from truearm.nets.perceptron import Perceptron
from truearm.pages.drawings.arm_drawing import arm_figure, frame_figure, project
from truearm.pages.plotting import figure_style, svg_element
from truearm.wings.gao2017.claim_figures import (
    box_figure,
    crossings,
    learning_rate_figure,
    outside_figure,
    scatter_figure,
    share_figure,
)
from truearm.wings.gao2017.results import BoxStudy, LearningRate, OutsideErrors, Scatter
from truearm.wings.gao2017.table_figure import STYLES, TableFigureRow, network_layers, table_figure

PARAMETERS = np.array([[0, 376, -90], [62, 0, -90], [0, 751, -90], [62, 0, -90], [0, 500, -90], [0, 15, 90.0]])


def arm_at(angles_deg):
    """Frames and tip of the founding paper's arm."""
    frames = [np.eye(4)]
    for angle, (a, d, alpha) in zip(angles_deg, PARAMETERS, strict=True):
        frames.append(frames[-1] @ screw_z(np.radians(angle), d) @ screw_x(np.radians(alpha), a))
    return np.array(frames), (frames[-1] @ [0, 0, 98, 1])[:3]


def drawn_lines(figure):
    return [line.get_xydata() for panel in figure.panels for axes in panel.axes for line in axes.lines]


def holds(lines, place):
    """Whether a mark or the end of a line is at a place [data units of the panel]."""
    return any(len(line) and np.isclose(line, place, rtol=1e-9, atol=1e-9).all(axis=1).any() for line in lines)


def every_figure():
    frames, tip = arm_at([0, -120, 0, 75, 0, -30])
    errors = {"trainlm": [8.0, 9.0], "varpro": [5.0]}
    row = TableFigureRow(("1", "10"), 8.5, 124.0, errors, {"trainlm": [None, 3.0], "varpro": [1.0]})
    scatter = Scatter("row 1", (8.0, 9.0), (8.0, 9.0), 0.1, (1,), (8.5,), 0.0)
    outside = OutsideErrors((0.0, 10.0), {"varpro": (0.01, 1.0), "nominal": (0.4, 0.4)}, (0.1, 9.0))
    return {
        "arm": arm_figure(frames, tip),
        "frames": frame_figure(frames, tip),
        "network": network_layers([6, 30, 30, 3]),
        "rows": table_figure([row, row], headings=("row", "units")),
        "scatter": scatter_figure(scatter),
        "rate": learning_rate_figure(LearningRate((0.1, 1.0), (1, 8), 8.2, (8.5, 8.0))),
        "box": box_figure(BoxStudy((20.0, 40.0), {1: (1.0, 4.0)}, {1: 2.0}), chosen=38.0),
        "outside": outside_figure(outside),
        "share": share_figure({"nominal": 0.45, "varpro": 0.01}, before="nominal"),
    }


def test_every_figure_has_a_caption_an_alternative_text_and_units():
    for name, figure in every_figure().items():
        assert all(svg_element(panel, "p-").startswith("<svg") for panel in figure.panels), name
        assert len(figure.alt) > 40, name
        assert figure.caption.endswith("."), name
        for axes in (axes for panel in figure.panels for axes in panel.axes):
            for label in (axes.get_xlabel(), axes.get_ylabel()):
                plain = label in ("", "learning rate")
                assert plain or label.endswith(("[mm]", "[s]", "[deg]", "[%]")), (name, label)


# The arm -------------------------------------------------------------------------------------------------------------


def test_the_view_keeps_lengths_across_it_and_shortens_none_into_more():
    random = np.random.default_rng(5)
    points = random.normal(size=(200, 3))
    flat = np.linalg.norm(project(points), axis=1)
    assert (flat <= np.linalg.norm(points, axis=1) + 1e-12).all()
    right, up = project(np.eye(3)).T
    np.testing.assert_allclose([right @ right, up @ up, right @ up], [1, 1, 0], atol=1e-15)


@pytest.mark.parametrize(
    "angles",
    [
        (0, -120, 0, 75, 0, -30),
        pytest.param((20, -100, 30, 60, -25, -10), marks=pytest.mark.weekly),
        (0, 0, 0, 0, 0, 0),
    ],
)
def test_the_arm_is_drawn_with_all_joints_and_its_tip(angles):
    frames, tip = arm_at(angles)
    figure = arm_figure(frames, tip)
    texts = [text.get_text() for text in figure.panels[0].axes[0].texts]
    assert {"J1", "J2", "J3", "J4", "J5", "J6", "tip", "x", "y"} < set(texts)
    lines = drawn_lines(figure)
    assert holds(lines, project([tip])[0])
    for frame in frames:
        assert holds(lines, project([frame[:3, 3]])[0])
    assert "1864 mm from the base to the tip along the links" in figure.caption
    details = frame_figure(frames, tip)
    labels = [text.get_text() for panel in details.panels for text in panel.axes[0].texts]
    assert {f"{letter}{i}" for letter in "xz" for i in range(7)} < set(labels)


@pytest.mark.parametrize(
    "angles",
    [
        (0, -120, 0, 75, 0, -30),
        *(
            pytest.param(one, marks=pytest.mark.weekly)
            for one in ((20, -100, 30, 60, -25, -10), (35, -90, -20, 40, 10, 20))
        ),
    ],
)
def test_labels_of_the_arm_do_not_cover_each_other_nor_leave_the_paper(angles):
    frames, tip = arm_at(angles)
    for figure in (arm_figure(frames, tip), frame_figure(frames, tip)):
        for panel in figure.panels:
            with figure_style():
                panel.draw_without_rendering()
                boxes = [text.get_window_extent() for text in panel.axes[0].texts if text.get_text()]
            for one, other in combinations(boxes, 2):
                assert not one.overlaps(other)
            width, height = panel.get_size_inches() * panel.dpi
            assert all(box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width and box.y1 <= height for box in boxes)


# The network ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sizes", [(6, 30, 30, 3), (6, 10, 3), (2, 300, 5, 1), (6, 3), (1, 1, 1)])
def test_the_network_is_drawn_with_its_units_biases_and_weights(sizes):
    figure = network_layers(sizes, activation="logsig")
    (axes,) = figure.panels[0].axes
    shown = [size if size <= 8 else 6 for size in sizes]  # of more units four and the last two
    assert sum(isinstance(patch, Circle) for patch in axes.patches) == sum(shown)
    assert sum(isinstance(patch, Rectangle) for patch in axes.patches) == len(sizes) - 1
    # Every unit is joined to all of the layer before, and to its bias.
    joined = sum(len(lines.get_segments()) for lines in axes.collections)
    assert joined == sum((a + 1) * b for a, b in pairwise(shown))
    texts = [text.get_text() for text in axes.texts]
    assert texts.count("logsig") == len(sizes) - 2
    assert f"{sizes[0]} input{'s' * (sizes[0] > 1)}" in texts
    assert "linear" in texts
    assert ("z" in texts) == (sizes[-1] == 3)
    weights = Perceptron(tuple(sizes), ("logsig",) * (len(sizes) - 2)).n_weights if len(sizes) > 2 else 7 * 3
    assert f"{weights} weights" in figure.caption.replace("\u202f", "")


# Rows of a table -----------------------------------------------------------------------------------------------------


def test_every_start_the_median_and_the_papers_value_are_drawn():
    rows = [
        TableFigureRow(
            ("1", "10"),
            8.5,
            124.0,
            {"trainlm": [8.0, 9.0, 10.0], "varpro": [5.0]},
            {"trainlm": [None, 3.0, None], "varpro": [1.0]},
        ),
        TableFigureRow(("2", "50"), 2.5, 21.0, {"trainlm": [2.0, 3.0]}, {"trainlm": [7.0, 8.0]}),
    ]
    figure = table_figure(rows, headings=("row", "units"))
    errors, times = (np.concatenate([line.get_xdata() for line in panel.axes[0].lines]) for panel in figure.panels)
    assert sorted(errors) == sorted([8.0, 9, 10, 5, 2, 3, 9.0, 5, 2.5, 8.5, 2.5])  # starts, medians, paper's
    # One start of three is no median; of two starts at 7 and 8 s the median is 7.5 s.
    assert sorted(times) == sorted([3.0, 1, 7, 8, 1, 7.5, 124, 21])
    edge = [text.get_text() for text in figure.panels[1].axes[0].texts]
    assert {"1/3", "1/1", "2/2"} < set(edge)


def test_a_trainer_keeps_its_colour_in_figures_without_the_other():
    row = TableFigureRow(("1",), 8.5, 124.0, {"varpro": [5.0]}, {"varpro": [1.0]})
    figure = table_figure([row], headings=("row",))
    colours = {to_hex(line.get_color()) for line in figure.panels[0].axes[0].lines}
    assert STYLES["varpro"].colour in colours
    assert STYLES["trainlm"].colour not in colours


# Claims --------------------------------------------------------------------------------------------------------------


def test_crossings_solved_by_hand():
    # Doubling every 10: the level of 8 lies half way between 4 at 20 and 16 at 40.
    assert crossings([40.0, 20.0], [16.0, 4.0], 8.0) == pytest.approx([30.0], abs=1e-12)
    assert crossings([0, 10, 20], [1.0, 4.0, 1.0], 2.0) == pytest.approx([5.0, 15.0], abs=1e-12)
    assert crossings([0, 10, 20], [1.0, 2.0, 3.0], 2.0) == [10.0]
    assert crossings([0, 10], [1.0, 2.0], 2.0) == [10.0]
    assert crossings([0, 10], [1.0, 2.0], 5.0) == []
    assert crossings([5], [1.0], 2.0) == []


def test_figures_of_claims_show_the_data_they_are_given():
    figures = every_figure()
    scatter, rate, box, outside = (drawn_lines(figures[name]) for name in ("scatter", "rate", "box", "outside"))
    assert {8.0, 9.0} <= set(np.concatenate([line[:, 0] for line in scatter]))
    assert holds(scatter, (8.5, 0.0))
    assert holds(rate, (1.0, 8.0))
    assert holds(rate, (0.1, 8.5))
    assert any((line[:, 1] == 8.2).all() for line in rate)
    assert holds(box, (20.0, 1.0))
    assert holds(box, (30.0, 2.0))  # where 2 mm is met
    assert holds(outside, (10.0, 1.0))
    assert holds(outside, (10.0, 9.0))
    assert holds(outside, (0.0, 0.4))
    assert "row 1 at \u00b130 deg" in figures["box"].caption
    assert "2 starts from 8.00 to 9.00 mm, 1 published value 8.50 mm throughout" in figures["scatter"].caption
    assert "rows from 8.00 to 8.50 mm; here one training, 8.20 mm" in figures["rate"].caption


def test_the_upper_scale_of_the_share_is_the_share():
    figure = share_figure({"nominal": 0.5, "varpro": 0.005}, before="nominal")
    (top,) = figure.panels[0].axes[0].child_axes
    ticks = dict(zip([label.get_text() for label in top.get_xticklabels()], top.get_xticks(), strict=True))
    assert ticks["0 %"] == pytest.approx(0.5)
    assert ticks["90 %"] == pytest.approx(0.05)
    assert "varpro 0.00500 mm, 99 % removed" in figure.caption
