"""Figures of a reproduction: what is drawn is what was given, labels keep apart, bad arrays are refused."""

from itertools import combinations, pairwise

import numpy as np
import pytest
from made_up_reproduction import made_up_arm
from matplotlib.colors import to_hex
from matplotlib.patches import Circle, Rectangle

from truearm.arm.transforms import screw_x, screw_z
from truearm.compensation.nets.perceptron import Perceptron
from truearm.errors import InputError
from truearm.pages.plotting import figure_style, styles_of, svg_element
from truearm.papers.gao2017.arm_drawing import arm_figure, denavit_hartenberg, frame_figure, project
from truearm.papers.gao2017.claim_figures import (
    crossings,
    error_against_box,
    error_against_rate,
    error_outside,
    scatter_of_starts,
    share_removed,
)
from truearm.papers.gao2017.network_drawing import network_layers
from truearm.papers.gao2017.prediction_figure import predictions_by_pose
from truearm.papers.gao2017.table_figure import TableFigureRow, reaches_paper_error, table_figure

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
    row = TableFigureRow(
        ("1", "10"), 8.5, 124.0, {"faithful": [8.0, 9.0], "lm": [5.0]}, {"faithful": [None, 3.0], "lm": [1.0]}
    )
    truth = np.arange(12.0).reshape(4, 3)
    return {
        "arm": arm_figure(frames, tip),
        "frames": frame_figure(frames, tip),
        "network": network_layers([6, 30, 30, 3]),
        "rows": table_figure([row, row], headings=("row", "units")),
        "scatter": scatter_of_starts([8.0, 9.0], [8.5]),
        "rate": error_against_rate([0.1, 1.0], [8.5, 8.0], 8.2),
        "box": error_against_box([20, 40], {"row 1": [1.0, 4.0]}, {"row 1": 2.0}, chosen=38),
        "outside": error_outside([0, 10], ([0.01, 1.0], [0.1, 9.0]), {"nominal": [0.4, 0.4]}),
        "share": share_removed({"nominal": 0.45, "network": 0.01}, before="nominal"),
        "poses": predictions_by_pose(truth, {"faithful": truth + 0.1, "lm": truth}),
    }


def test_every_figure_is_drawn_told_and_labelled_with_its_unit():
    for name, figure in every_figure().items():
        assert all(svg_element(panel, "p-").startswith("<svg") for panel in figure.panels), name
        assert len(figure.alt) > 40, name
        assert figure.caption.endswith("."), name
        for axes in (axes for panel in figure.panels for axes in panel.axes):
            for label in (axes.get_xlabel(), axes.get_ylabel()):
                plain = label in ("", "pose", "learning rate")
                assert plain or label.endswith(("[mm]", "[s]", "[deg]", "[%]")), (name, label)


# The arm -------------------------------------------------------------------------------------------------------------


def test_parameters_of_the_frames_are_those_they_were_made_of():
    random = np.random.default_rng(4)
    for _ in range(20):
        angles = random.uniform(-179, 179, 6)
        found = denavit_hartenberg(arm_at(angles)[0])
        # Lengths to 1e-9 of a metre-sized arm, angles to 1e-9 rad: rounding of six products.
        np.testing.assert_allclose(found[:, [0, 1]], PARAMETERS[:, [0, 1]], atol=1e-9)
        np.testing.assert_allclose(found[:, 2], np.radians(angles), atol=1e-9)
        np.testing.assert_allclose(found[:, 3], np.radians(PARAMETERS[:, 2]), atol=1e-9)


def test_the_sample_arm_of_the_tests_is_the_catalogues():
    made = made_up_arm()
    from truearm.arm.catalogue import load_arm

    arm = load_arm("gao2017")
    # The two ways to the tip agree to rounding [mm].
    np.testing.assert_allclose(arm.chain.tip_in_base(arm.working[None])[0], made["tip_mm"], atol=1e-9)


def test_the_view_keeps_lengths_across_it_and_shortens_none_into_more():
    random = np.random.default_rng(5)
    points = random.normal(size=(200, 3))
    flat = np.linalg.norm(project(points), axis=1)
    assert (flat <= np.linalg.norm(points, axis=1) + 1e-12).all()
    right, up = project(np.eye(3)).T
    np.testing.assert_allclose([right @ right, up @ up, right @ up], [1, 1, 0], atol=1e-15)


@pytest.mark.parametrize("angles", [(0, -120, 0, 75, 0, -30), (20, -100, 30, 60, -25, -10), (0, 0, 0, 0, 0, 0)])
def test_the_arm_is_drawn_with_all_joints_and_its_tip(angles):
    frames, tip = arm_at(angles)
    figure = arm_figure(frames, tip)
    texts = [text.get_text() for text in figure.panels[0].axes[0].texts]
    assert {"q1", "q2", "q3", "q4", "q5", "q6", "tip", "x", "y"} < set(texts)
    lines = drawn_lines(figure)
    assert holds(lines, project([tip])[0])
    for frame in frames:
        assert holds(lines, project([frame[:3, 3]])[0])
    assert "1864 mm from the base to the tip along the links" in figure.caption
    details = frame_figure(frames, tip)
    labels = [text.get_text() for panel in details.panels for text in panel.axes[0].texts]
    assert {f"{letter}{i}" for letter in "xz" for i in range(7)} < set(labels)


@pytest.mark.parametrize("angles", [(0, -120, 0, 75, 0, -30), (20, -100, 30, 60, -25, -10), (35, -90, -20, 40, 10, 20)])
def test_labels_of_the_arm_do_not_cover_each_other_nor_leave_the_paper(angles):
    frames, tip = arm_at(angles)
    for figure in (arm_figure(frames, tip), frame_figure(frames, tip)):
        for panel in figure.panels:
            with figure_style():
                panel.canvas.draw()
                boxes = [text.get_window_extent() for text in panel.axes[0].texts if text.get_text()]
            for one, other in combinations(boxes, 2):
                assert not one.overlaps(other)
            width, height = panel.get_size_inches() * panel.dpi
            assert all(box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width and box.y1 <= height for box in boxes)


@pytest.mark.parametrize(
    ("frames", "told"),
    [
        (np.eye(4), r"\(n_joints \+ 1, 4, 4\), got the shape \(4, 4\)"),
        ([np.eye(4)], r"got the shape \(1, 4, 4\)"),
        ([np.eye(4), 2 * np.eye(4)], "rigid frames, a rotation and a place, but frame 1 is none"),
        ([np.eye(4), np.diag([1.0, 1, -1, 1])], "frame 1 is none"),
        ([np.eye(4), np.full((4, 4), np.nan)], "rigid frames, a rotation and a place, but frame 1"),
        # x of the second frame along z of the first; and a shift across both.
        ([np.eye(4), np.array([[0, 1.0, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])], "frame 1 to follow from"),
        ([np.eye(4), np.array([[1.0, 0, 0, 0], [0, 1, 0, 5], [0, 0, 1, 0], [0, 0, 0, 1]])], "by theta, d, a and alpha"),
    ],
)
def test_frames_of_another_kind_are_refused(frames, told):
    with pytest.raises(InputError, match=told):
        arm_figure(frames, [0.0, 0.0, 0.0])


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


@pytest.mark.parametrize("sizes", [(6,), (), (6, 0, 3), (6, *[5] * 11, 3)])
def test_what_is_no_network_is_refused(sizes):
    with pytest.raises(InputError, match="2 to 12 layers, each of one unit or more"):
        network_layers(sizes)


# Rows of a table -----------------------------------------------------------------------------------------------------


def test_every_start_the_median_and_the_papers_value_are_drawn():
    rows = [
        TableFigureRow(
            ("1", "10"), 8.5, 124.0, {"a": [8.0, 9.0, 10.0], "b": [5.0]}, {"a": [None, 3.0, None], "b": [1.0]}
        ),
        TableFigureRow(("2", "50"), 2.5, 21.0, {"a": [2.0, 3.0]}, {"a": [7.0, 8.0]}),
    ]
    figure = table_figure(rows, headings=("row", "units"))
    errors, times = (np.concatenate([line.get_xdata() for line in panel.axes[0].lines]) for panel in figure.panels)
    assert sorted(errors) == sorted([8.0, 9, 10, 5, 2, 3, 9.0, 5, 2.5, 8.5, 2.5])  # starts, medians, paper's
    # One start of three is no median; of two starts at 7 and 8 s the median is 7.5 s.
    assert sorted(times) == sorted([3.0, 1, 7, 8, 1, 7.5, 124, 21])
    edge = [text.get_text() for text in figure.panels[1].axes[0].texts]
    assert {"1/3", "1/1", "2/2"} < set(edge)


def test_a_trainer_keeps_its_colour_whoever_else_was_run():
    row = TableFigureRow(("1",), 8.5, 124.0, {"lm": [5.0]}, {"lm": [1.0]})
    styles = styles_of(("faithful", "lm"))
    figure = table_figure([row], headings=("row",), styles=styles)
    colours = {to_hex(line.get_color()) for line in figure.panels[0].axes[0].lines}
    assert styles["lm"].colour in colours
    assert styles["faithful"].colour not in colours


@pytest.mark.parametrize(
    ("seconds", "there"), [([], False), ([None], False), ([1.0], True), ([1.0, None], True), ([1.0, None, None], False)]
)
def test_half_of_the_starts_are_enough(seconds, there):
    assert reaches_paper_error(seconds) is there


@pytest.mark.parametrize(
    ("draw", "told"),
    [
        (lambda: table_figure([], headings=("row",)), "at least one row"),
        (
            lambda: table_figure([TableFigureRow(("1",), 1.0, 1.0, {}, {})], headings=("row", "units")),
            "a label of 2 cells for every row",
        ),
    ],
)
def test_rows_that_cannot_be_are_refused(draw, told):
    with pytest.raises(InputError, match=told):
        draw()


# Claims --------------------------------------------------------------------------------------------------------------


def test_crossings_solved_by_hand():
    # Doubling every 10: the level of 8 lies half way between 4 at 20 and 16 at 40.
    assert crossings([40.0, 20.0], [16.0, 4.0], 8.0) == pytest.approx([30.0], abs=1e-12)
    assert crossings([0, 10, 20], [1.0, 4.0, 1.0], 2.0) == pytest.approx([5.0, 15.0], abs=1e-12)
    assert crossings([0, 10, 20], [1.0, 2.0, 3.0], 2.0) == [10.0]
    assert crossings([0, 10], [1.0, 2.0], 2.0) == [10.0]
    assert crossings([0, 10], [1.0, 2.0], 5.0) == []
    assert crossings([5], [1.0], 2.0) == []


def test_figures_of_claims_hold_what_they_were_given():
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
    assert "2 starts from 8.00 to 9.00 mm, 1 published values 8.50 mm throughout" in figures["scatter"].caption
    assert "rows from 8.00 to 8.50 mm; here one training, 8.20 mm" in figures["rate"].caption


def test_the_upper_scale_of_the_share_is_the_share():
    figure = share_removed({"nominal": 0.5, "network": 0.005}, before="nominal")
    (top,) = figure.panels[0].axes[0].child_axes
    ticks = dict(zip([label.get_text() for label in top.get_xticklabels()], top.get_xticks(), strict=True))
    assert ticks["0 %"] == pytest.approx(0.5)
    assert ticks["90 %"] == pytest.approx(0.05)
    assert "network 0.00500 mm, 99 % removed" in figure.caption


def test_true_and_predicted_coordinates_and_their_differences_are_drawn():
    truth = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    figure = predictions_by_pose(truth, {"lm": truth + [0.1, -0.2, 0.3]})
    for k, (panel, error) in enumerate(zip(figure.panels, (0.1, -0.2, 0.3), strict=True)):
        above, below = panel.axes
        assert holds([line.get_xydata() for line in above.lines], (1.0, truth[0, k]))
        assert holds([line.get_xydata() for line in below.lines], (2.0, error))
    assert "lm 0.20 mm on average and 0.30 mm at most" in figure.caption


@pytest.mark.parametrize(
    ("draw", "told"),
    [
        (lambda: scatter_of_starts([], [1.0]), "at least one value in numbers of 'starts'"),
        (lambda: scatter_of_starts([1.0], [0.0]), "published errors above zero, got 0 at place 1"),
        (lambda: error_against_rate([1.0, 2.0], [1.0], 1.0), "an error for each of 2 rates, got 1"),
        (lambda: error_against_box([1.0], {"a": [1.0, 2.0]}, {"a": 1.0}, chosen=1), "'a' for 1 half-widths, got 2"),
        (lambda: error_against_box([1.0], {"a": [1.0]}, {}, chosen=1), "published error for every network, got none"),
        (lambda: error_outside([0.0], ([1.0], [1.0, 2.0]), {}), "'lm, 95 %' at 1 distances, got 2"),
        (lambda: error_outside([np.nan], ([1.0], [1.0]), {}), "finite numbers in distances from the box"),
        (lambda: share_removed({"a": 1.0}, before="b"), "the error of 'b' among the errors, got a"),
        (lambda: share_removed({"a": -1.0}, before="a"), "of zero or more, got -1"),
        (lambda: predictions_by_pose(np.ones((2, 3)), {"a": np.ones((3, 3))}), "the same 2 poses as the truth, got 3"),
    ],
)
def test_bad_arrays_of_claims_are_refused(draw, told):
    with pytest.raises(InputError, match=told):
        draw()
