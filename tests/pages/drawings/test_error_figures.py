"""Figures: units on every axis, one colour a model, no surprise from odd data, bad data refused with its place."""

import re
import sys
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.image import imread

from refusals import refuses
from truearm.errors import InputError
from truearm.pages.drawings import error_figures as figures
from truearm.pages.drawings import joint_figures
from truearm.pages.drawings.joint_figures import running_median
from truearm.pages.drawings.workspace_figures import error_in_workspace, workspace
from truearm.pages.plotting import Style, styles_of, svg_element


def made_up(readings=60, joints=6, seed=1):
    """Angles [rad], points [mm] and errors [mm] of plausible shape: a systematic one, and two of noise."""
    random = np.random.default_rng(seed)
    angles = random.uniform(-0.35, 0.35, (readings, joints))
    points = np.array([500.0, -200.0, 400.0]) + 300 * random.uniform(-1, 1, (readings, 3))
    wave = 0.4 * np.sin(angles[:, :1]) + np.array([0.3, -0.2, 0.2])
    errors = {
        "nominal": wave + random.normal(0, 0.01, (readings, 3)),
        "network": random.normal(0, 0.008, (readings, 3)),
        "kinematic": random.normal(0, 0.006, (readings, 3)),
    }
    return angles, points, errors, {name: np.linalg.norm(e, axis=1) for name, e in errors.items()}


def all_figures(readings=60, joints=6):
    angles, points, errors, lengths = made_up(readings, joints)
    measured = {name: points + e for name, e in errors.items()}
    return {
        "workspace": workspace(points),
        "joint_ranges": joint_figures.joint_ranges(angles, lower=np.full(joints, -3.0), upper=np.full(joints, 3.0)),
        "errors_by_reading": figures.errors_by_reading(errors),
        "coordinates_by_reading": figures.coordinates_by_reading(points, measured),
        "error_distribution": figures.error_distribution(lengths),
        "error_against_joint": joint_figures.error_against_joint(angles, lengths),
        "before_after": figures.before_after(lengths),
        "error_in_workspace": error_in_workspace(points, lengths["nominal"], name="nominal"),
    }


def texts_of(figure):
    return " ".join(svg_element(panel, "p-") for panel in figure.panels)


def visible_axes(figure):
    return [axes for panel in figure.panels for axes in panel.axes if axes.get_xlabel() or axes.get_ylabel()]


def test_every_axis_names_its_unit_unless_it_counts():
    for name, figure in all_figures().items():
        assert visible_axes(figure), name
        for axes in visible_axes(figure):
            for label in (axes.get_xlabel(), axes.get_ylabel()):
                counts = label in ("", "reading", "readings in each class")
                assert counts or label.endswith(("[mm]", "[deg]", "[%]")), (name, label)
        assert len(figure.alt) > 40, name
        assert figure.caption.endswith("."), name


@pytest.mark.parametrize(("readings", "joints"), [(1, 1), pytest.param(2, 12, marks=pytest.mark.weekly), (40, 7)])
def test_few_readings_and_any_number_of_joints_are_drawn(readings, joints):
    drawn = all_figures(readings, joints) if readings < 40 else None
    angles, _, _, lengths = made_up(readings, joints)
    figure = joint_figures.error_against_joint(angles, lengths)
    assert len(figure.panels) == joints
    assert f"J{joints}" in svg_element(figure.panels[-1], "p-")
    for other in (drawn or {}).values():
        assert texts_of(other)


def test_errors_of_zero_and_joints_at_rest_are_drawn():
    zero = {"a": np.zeros(20), "b": np.zeros(20)}
    still = np.full((20, 2), 0.5)
    for figure in (
        figures.error_distribution(zero),
        figures.before_after(zero),
        joint_figures.error_against_joint(still, zero),
        joint_figures.joint_ranges(still),
        figures.errors_by_reading({"a": np.zeros((20, 3)), "b": np.zeros((20, 3))}),
        error_in_workspace(np.ones((20, 3)), np.zeros(20)),
    ):
        assert texts_of(figure)


def test_some_zeros_among_errors_do_not_break_the_logarithmic_scale():
    lengths = {"before": np.full(50, 0.4), "after": np.r_[np.zeros(10), np.full(40, 0.01)]}
    assert "logarithmic" in figures.error_distribution(lengths).caption
    assert texts_of(figures.error_distribution(lengths))


def test_sliding_joints_are_drawn_in_millimetres_apart_from_degrees():
    angles = np.column_stack([np.linspace(-1, 1, 30), np.linspace(0, 250, 30)])
    figure = joint_figures.joint_ranges(
        angles, names=["turn", "slide"], lower=[-np.inf, 0], upper=[np.inf, 300], sliding=[False, True]
    )
    turn, slide = figure.panels
    assert turn.axes[0].get_xlabel().endswith("[deg]")
    assert slide.axes[0].get_xlabel().endswith("[mm]")
    assert "turn \u221257 to 57 deg" in figure.alt
    assert "slide 0 to 250 mm" in figure.alt


def test_the_running_median_finds_a_planted_wave():
    random = np.random.default_rng(3)
    x = random.uniform(-np.pi, np.pi, 2000)
    x_median, y_median = running_median(x, np.sin(3 * x) + random.normal(0, 0.2, 2000))
    # A window holds 50 readings: its median scatters by about 1.25 * 0.2 / sqrt(50) = 0.035; four of those, and the
    # bend of the wave within a window of 0.16 rad, at most 0.01.
    assert np.abs(y_median - np.sin(3 * x_median)).max() < 0.15


def test_too_few_readings_have_no_running_median():
    assert running_median(np.arange(10.0), np.arange(10.0))[0].size == 0


def test_a_model_keeps_its_colour_in_figures_without_the_others():
    styles = styles_of(["nominal", "network", "kinematic"])
    only = styles_of(["kinematic"], styles)
    assert only == {"kinematic": styles["kinematic"]}
    _, _, _, lengths = made_up()
    figure = figures.before_after({"kinematic": lengths["kinematic"]}, styles=styles)
    colours = {to_hex(c.get_facecolor()[0]) for c in figure.panels[0].axes[0].collections}
    assert colours == {styles["kinematic"].colour}


def test_the_pens_differ_in_colour_and_without_it():
    pens = list(styles_of("abcdef").values())
    assert len({pen.colour for pen in pens}) == 6
    assert len({pen.marker for pen in pens}) == 6
    assert all(isinstance(pen, Style) for pen in pens)
    # Lightness (Rec. 709 luma of the first three) must part them on grey paper by at least a tenth of the scale.
    luma = sorted(
        sum(w * int(pen.colour[i : i + 2], 16) for w, i in ((0.21, 1), (0.72, 3), (0.07, 5))) / 255 for pen in pens[:3]
    )
    assert min(np.diff(luma)) > 0.1


@pytest.mark.parametrize(
    "name", ["<script>alert(1)</script>", "$\\frac{1}$", "_hidden", "模型", "a\x00\x07b", "", "m" * 300]
)
def test_odd_names_are_drawn_as_they_are(name):
    angles, _, errors, lengths = made_up(30, 2)
    odd = {name: lengths["nominal"], "other": lengths["network"]}
    drawn = [figures.before_after(odd), joint_figures.joint_ranges(angles, names=[name, "J2"])]
    if name.startswith(("<", "$")):  # what a picture or its formulas could take for their own
        drawn += [
            figures.error_distribution(odd),
            joint_figures.error_against_joint(angles, odd, names=[name, "J2"]),
            figures.errors_by_reading({name: errors["nominal"], "other": errors["network"]}),
        ]
    for figure in drawn:
        assert "<script" not in texts_of(figure)
    assert "<use" in svg_element(figures.before_after(odd).panels[0], "p-")


def test_more_models_than_pens_are_drawn():
    lengths = {f"model {i}": np.linspace(0.1, 1, 30) / (i + 1) for i in range(8)}
    assert texts_of(figures.error_distribution(lengths))
    assert texts_of(figures.errors_by_reading({k: np.column_stack([v] * 3) for k, v in lengths.items()}))


@pytest.mark.parametrize(
    ("draw", "told"),
    [
        (lambda: workspace(np.empty((0, 3))), "at least one value in points, got none"),
        (lambda: workspace(np.ones((5, 2))), r"points as an array \(n, 3\), got the shape \(5, 2\)"),
        (lambda: workspace([[1, 2, np.nan]]), "finite numbers in points, got nan as number 1"),
        (lambda: workspace("points"), "expected numbers as points, got str"),
        (lambda: figures.before_after({}), "errors under at least one name, got none"),
        (lambda: figures.before_after({"m": [1.0, np.inf]}), "errors of 'm', got inf as number 2"),
        (lambda: figures.before_after({"m": [1.0, -1.0]}), "errors of 'm' of zero or more, got -1 as number 2"),
        (
            lambda: figures.errors_by_reading({"a": np.ones((2, 3)), "b": np.ones((3, 3))}),
            "under every name, got 'a' 2, 'b' 3",
        ),
        (
            lambda: joint_figures.error_against_joint(np.ones((4, 2)), {"a": np.ones(3)}),
            "3 readings as the errors, got 4",
        ),
        (
            lambda: joint_figures.error_against_joint(np.ones((3, 0)), {"a": np.ones(3)}),
            r"joints\), got the shape \(3, 0\)",
        ),
        (lambda: error_in_workspace(np.ones((3, 3)), np.ones(2)), "got 3 points and 2 errors"),
        (
            lambda: figures.coordinates_by_reading(np.ones((3, 3)), {"a": np.ones((2, 3))}),
            "3 readings as the truth, got 2",
        ),
        (lambda: figures.before_after({"m": [1.0]}, styles={}), "a style for every series, got none for 'm'"),
    ],
)
def test_bad_arrays_are_refused_with_what_came_and_where(draw, told):
    refuses(told, draw)


def test_the_arrays_given_are_left_as_they_were():
    angles, points, _, lengths = made_up()
    before = angles.copy(), points.copy(), lengths["nominal"].copy()
    joint_figures.joint_ranges(angles)
    error_in_workspace(points, lengths["nominal"])
    assert all(np.array_equal(a, b) for a, b in zip(before, (angles, points, lengths["nominal"]), strict=True))


def test_drawing_leaves_the_users_settings_alone_and_does_not_heed_them():
    _, _, _, lengths = made_up()
    plain = svg_element(figures.before_after(lengths).panels[0], "p-")
    with mpl.rc_context({"font.size": 30, "axes.facecolor": "black", "text.usetex": True}):
        kept = dict(mpl.rcParams)
        assert svg_element(figures.before_after(lengths).panels[0], "p-") == plain
        assert dict(mpl.rcParams) == kept


def test_figures_do_not_wake_pyplot():
    # pyplot keeps every figure alive and picks a window system; the report needs neither.
    assert all_figures(5)
    assert "matplotlib.pyplot" not in sys.modules or not sys.modules["matplotlib.pyplot"].get_fignums()


def test_a_picture_is_saved_whole_and_alike_each_time(tmp_path):
    _, _, errors, lengths = made_up()
    figures.before_after(lengths).save(tmp_path / "a.png", dpi=80)
    figures.before_after(lengths).save(tmp_path / "b.png", dpi=80)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    figures.errors_by_reading(errors).save(tmp_path / "three.png", dpi=80)
    one, three = imread(tmp_path / "a.png"), imread(tmp_path / "three.png")
    assert three.shape[1] == 3 * 3.0 * 80  # three panels of three inches side by side
    assert 0.02 < np.mean(one[..., :3].min(axis=-1) < 0.9) < 0.5  # something is drawn, on much white
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "b.png", "three.png"]


def test_drawings_are_saved_whole_and_alike_each_time_with_unique_ids(tmp_path):
    _, _, errors, lengths = made_up()
    for ending in (".svg", ".pdf"):
        for name in ("a", "b"):
            figures.errors_by_reading(errors).save(tmp_path / f"{name}{ending}")
        assert (tmp_path / f"a{ending}").read_bytes() == (tmp_path / f"b{ending}").read_bytes()
    root = ElementTree.parse(tmp_path / "a.svg").getroot()
    ids = [element.get("id") for element in root.iter() if element.get("id")]
    assert len(ids) == len(set(ids))
    used = re.findall(r"(?:url\(#|href=\"#)([^)\"]+)", (tmp_path / "a.svg").read_text(encoding="utf-8"))
    assert used
    assert set(used) <= set(ids)
    panels = root.findall("{http://www.w3.org/2000/svg}svg")
    assert len(panels) == 3
    assert [float(panel.get("x")) for panel in panels] == [0.0, 216.0, 432.0]  # three inches each, side by side
    pdf = (tmp_path / "a.pdf").read_bytes()
    assert len(re.findall(rb"/Type /Page\b", pdf)) == 1
    assert b"/CIDFontType2" in pdf  # TrueType: publishers refuse Type 3 fonts
    assert b"/Type3" not in pdf
    with pytest.raises(InputError, match=r"expected a file name that ends in \.png, \.svg, \.pdf, got 'a\.eps'"):
        figures.before_after(lengths).save(tmp_path / "a.eps")


def test_a_missing_folder_is_named(tmp_path):
    _, _, _, lengths = made_up(5)
    refuses("does not exist", figures.before_after(lengths).save, tmp_path / "none" / "a.png")


def test_a_few_readings_have_a_largest_error_and_no_95th_percentile():
    assert "largest 0.30 mm" in figures.error_distribution({"m": np.full(19, 0.3)}).caption
    assert "95 % below 0.30 mm" in figures.error_distribution({"m": np.full(20, 0.3)}).caption


def test_captions_stay_short_with_many_models_and_speak_of_one_reading():
    lengths = {f"m{i}": np.full(30, 0.1 * (i + 1)) for i in range(9)}
    assert "m3 0.400 mm; and 5 more" in figures.before_after(lengths).caption
    assert "1 reading in" in workspace([[1.0, 2.0, 3.0]]).caption
