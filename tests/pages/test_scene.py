"""Interactive scenes: their numbers in the page, what they refuse, and that no text of others becomes a script."""

import base64
import hashlib
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import truearm.pages
from refusals import refuses
from truearm.pages.drawings.workspace_figures import workspace
from truearm.pages.html import render
from truearm.pages.page import Page, Section
from truearm.pages.scene import MOST_POINTS, Mechanism, PointCloud, PointColumn, Scene, scene_script, thinned

STILL = workspace(np.eye(3) * 100)
HOSTILE = "</script><script>alert('x')</script><!--"


def made_up_cloud(n=60, *, name="error", axes=2, most=1.0):
    """Points with plausible errors [mm] that depend on the first axis."""
    random = np.random.default_rng(7)
    points = random.uniform(-500, 500, (n, 3))
    angles = random.uniform(-90, 90, (n, axes))
    error = 0.05 * most * (1.2 + np.sin(np.radians(angles[:, 0]))) + random.uniform(0, 0.01, n)
    return PointCloud(
        points,
        [f"line {i + 2}" for i in range(n)],
        [PointColumn(name, "mm", error), PointColumn("before", "mm", 10 * error)],
        [PointColumn(f"A{k + 1}", "deg", angles[:, k]) for k in range(axes)],
        [PointColumn("u", "mm", np.full(n, 0.02))],
        noun="reading",
    )


def two_pivots(**changed):
    eye = np.eye(4)
    shifted = eye.copy()
    shifted[0, 3] = 100.0
    given = {
        "fixed": np.array([eye, shifted, eye]),
        "end": np.array([50.0, 0, 0]),
        "links": [np.zeros((2, 3)), np.array([[0, 0, 0], [100, 0, 0]]), np.array([[0, 0, 0], [50, 0, 0]])],
        "names": ["A1", "A2"],
        "units": ["deg", "mm"],
        "lower": np.array([-90.0, -10]),
        "upper": np.array([90.0, 10]),
        "limited": np.array([True, False]),
        "start": np.zeros(2),
        "end_name": "end",
        "value_name": "value",
        "controls": True,
    }
    return Mechanism(**(given | changed))


def scene_page(**parts):
    scene = Scene("points in space", "mm", STILL, **parts)
    return Page("a scene", sections=(Section("Look", scenes=(scene,)),))


def data_of(html):
    return json.loads(re.search(r'<script type="application/json">(.*?)</script>', html, flags=re.DOTALL)[1])


def test_the_numbers_of_the_page_are_those_given():
    cloud = made_up_cloud()
    data = data_of(render(scene_page(cloud=cloud)))["points"]
    for axis, column in enumerate(data["at"]):
        # Half a step, a two-thousandth of the span: less than a pixel.
        np.testing.assert_allclose(np.array(column["data"]) * column["step"], cloud.points[:, axis], atol=0.25)
    for given_, column in zip(
        [*cloud.values, *cloud.axes, *cloud.notes], data["values"] + data["axes"] + data["notes"], strict=True
    ):
        found = np.array(column["data"]) * column["step"]
        np.testing.assert_allclose(found, given_.values, rtol=2e-3, atol=5e-2 if column["unit"] == "deg" else 1e-6)
        assert (column["name"], column["unit"]) == (given_.name, given_.unit)
    assert data["names"] == {"before": "line ", "last": [*range(2, 62)]}


@given(st.lists(st.floats(0, 1e6, allow_subnormal=False), min_size=1, max_size=30))
def test_values_of_any_size_keep_three_digits(values):
    column = PointCloud(np.zeros((len(values), 3)), ["p"] * len(values), [PointColumn("e", "mm", values)])
    (shown,) = column.to_json()["values"]
    found = np.array(shown["data"]) * shown["step"]
    # A thousandth of the median or, where it is zero, what cannot be seen on the scale.
    assert np.abs(found - values).max() <= max(np.median(values) / 1000, np.ptp(values) / 2000, 1e-9 * max(values))
    assert shown["top"] > 0


def test_no_text_ends_the_data_or_becomes_a_script():
    cloud = made_up_cloud(4, name=HOSTILE)
    html = render(scene_page(cloud=PointCloud(cloud.points, [HOSTILE] * 4, cloud.values, noun=HOSTILE)))
    assert html.count("<script") == html.count("</script>") == 2
    data = data_of(html)["points"]
    assert data["names"]["last"][0] == data["values"][0]["name"] == data["noun"] == HOSTILE


def test_the_policy_permits_the_script_of_the_page_and_no_other():
    html = render(scene_page(cloud=made_up_cloud()))
    (script,) = re.findall(r"<script>(.*?)</script>", html, flags=re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', html)[1]
    assert policy == f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{digest}'"


def test_a_page_without_scenes_has_no_script():
    html = render(Page("plain", sections=(Section("S", "text"),)))
    assert "<script" not in html
    assert "script-src" not in html
    assert ".scene" not in html


def test_the_same_scene_has_the_same_bytes():
    assert render(scene_page(cloud=made_up_cloud())) == render(scene_page(cloud=made_up_cloud()))


def test_spans_and_marks_belong_to_the_points_that_are_kept():
    n = MOST_POINTS + 100
    random = np.random.default_rng(1)
    ends = random.uniform(-1, 1, (n, 2, 3)).round(4)
    error = PointColumn("e", "mm", random.uniform(1, 2, n), top=1.5)
    cloud = PointCloud(
        ends.mean(axis=1), [str(i) for i in range(n)], [error], spans=dict(enumerate(ends)), marked={7: "A", n - 1: "B"}
    )
    data = cloud.to_json()
    names = data["names"]["last"]
    assert len(data["spans"]) == len(names) <= MOST_POINTS + 2
    assert all(span == ends[names[i]].ravel().tolist() for i, *span in data["spans"])
    assert {names[i]: text for i, text in data["marked"]} == {7: "A", n - 1: "B"}
    # The end of the colours is the given one, and that points lie beyond it is said.
    assert (data["values"][0]["top"], data["values"][0]["beyond"]) == (1.5, True)


def test_of_too_many_points_the_largest_and_an_even_selection_are_kept():
    random = np.random.default_rng(1)
    values = [random.exponential(1.0, 50_000), random.exponential(1.0, 50_000)]
    kept = thinned(values)
    assert len(kept) == len(set(kept.tolist())) == MOST_POINTS
    for one in values:
        assert set(np.argsort(one)[-300:]) <= set(kept.tolist())
    # Evenly: every thousandth part of the readings has its share of 12 points.
    assert np.histogram(kept, 1000, (0, 50_000))[0].min() >= 10
    cloud = PointCloud(np.zeros((50_000, 3)), ["p"] * 50_000, [PointColumn("e", "mm", values[0])])
    assert "12\u202f000 of 50\u202f000 points" in Scene("many", "mm", STILL, cloud=cloud).remark
    assert thinned(values, 60_000).tolist() == list(range(50_000))


def test_a_page_of_12000_points_stays_small():
    page = render(scene_page(cloud=made_up_cloud(12_000, axes=6)))
    assert len(page.encode()) < 1_000_000  # a mail takes 3 MB, and a page has other figures too


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda: PointCloud(np.zeros((2, 3)), ["a"], [PointColumn("e", "mm", [1, 2])]).to_json(), "expected 2 names"),
        (lambda: PointCloud(np.zeros((2, 3)), ["a", "b"], []).to_json(), "at least one value"),
        (lambda: PointCloud(np.zeros((1, 3)), ["a"], [PointColumn("e", "mm", [1, 2])]).to_json(), "expected 1 values"),
        (
            lambda: PointCloud(np.zeros((1, 3)), ["a"], [PointColumn("e", "mm", [-1])]).to_json(),
            "of zero or more, got -1",
        ),
        (lambda: PointCloud(np.zeros((1, 3)), ["a"], [PointColumn("e", "mm", [np.nan])]).to_json(), "finite numbers"),
        (lambda: PointCloud(np.zeros((1, 2)), ["a"], [PointColumn("e", "mm", [1])]).to_json(), r"\(n, 3\)"),
        (
            lambda: PointCloud(np.zeros((1, 3)), ["a"], [PointColumn("e", "mm", [1])], marked={1: "b"}).to_json(),
            "points 0 to 0, got one of point 1",
        ),
        (
            lambda: PointCloud(
                np.zeros((1, 3)), ["a"], [PointColumn("e", "mm", [1])], spans={0: [[np.nan] * 3] * 2}
            ).to_json(),
            "finite numbers in the ends of a span",
        ),
        (lambda: two_pivots(names=["A1"]).to_json("mm"), "a mechanism with 1 pivots"),
        (lambda: two_pivots(start=np.zeros(3)).to_json("mm"), "a mechanism with 2 pivots"),
    ],
)
def test_what_a_scene_cannot_hold_is_refused(make, problem):
    refuses(problem, make)


@pytest.mark.skipif(shutil.which("node") is None, reason="no node here (on Debian: apt-get install nodejs)")
def test_the_script_of_the_page_can_be_parsed(tmp_path):
    (tmp_path / "scene.js").write_text(scene_script(), encoding="utf-8")
    done = subprocess.run(["node", "--check", "scene.js"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(shutil.which("node") is None, reason="no node here (on Debian: apt-get install nodejs)")
def test_zooming_at_a_place_keeps_it_there_and_approaching_a_part_fills_the_picture(tmp_path):
    modules = Path(truearm.pages.__file__).parent
    (tmp_path / "zoom.mjs").write_text(
        f"""import {{ Camera }} from "{(modules / "scene_space.mjs").as_uri()}";
const camera = new Camera({{ middle: [10, 20, 30], radius: 500 }});
camera.fit(800, 600);
camera.turn(17, 8);
const at = camera.target.map((value, k) => value + 120 * camera.right[k] - 70 * camera.up[k]);
const [x, y] = camera.project(...at);
camera.magnify(2.5, x, y);
const kept = camera.project(...at).map((value, k) => value - [x, y, 0][k]);
camera.approach({{ middle: at, radius: 25 }});
console.log(JSON.stringify([...kept, ...camera.project(...at), camera.zoom, camera.pixels()]));
""",
        encoding="utf-8",
    )
    done = subprocess.run(["node", "zoom.mjs"], cwd=tmp_path, capture_output=True, text=True, check=True)
    numbers = json.loads(done.stdout)
    np.testing.assert_allclose(numbers[:2], 0.0, atol=1e-9)  # pixels
    np.testing.assert_allclose(numbers[3:5], [400, 300], atol=1e-9)
    # The part of 25 mm takes 0.8 of what the scene of 500 mm took: 0.46 of the smaller side, 600 pixels times 1.25.
    assert numbers[6:] == pytest.approx([0.8 * 500 / 25, 0.8 * 0.46 * 750 / 25])


def test_the_scripts_are_short_and_reach_for_nothing_outside():
    code = scene_script()
    assert not re.search(
        r"\b(eval|fetch|XMLHttpRequest|WebSocket|innerHTML|document\.write|localStorage)\b|https?:", code
    )
    assert "import " not in code
    assert max(map(len, code.splitlines())) <= 120
