"""The camera model: derivatives against difference quotients, pixels against OpenCV's, files."""

import numpy as np
import pytest

from truearm.errors import InputError
from truearm.wings.camera.lenses import Lens, camera_yaml, parse_camera, read_camera

LENSES = {
    "brown": Lens(1280, 1024, 1400.0, 1395.0, 650.2, 500.7, "brown", [-0.21, 0.12, 8e-4, -5e-4, 0.03]),
    "rational": Lens(640, 480, 610.0, 611.0, 322.0, 236.0, "brown", [0.4, -2.3, 3e-4, -2e-4, 1.3, 0.3, -2.1, 1.2]),
    "fisheye": Lens(1280, 800, 420.0, 421.0, 638.0, 402.0, "fisheye", [0.03, -0.01, 4e-3, -8e-4]),
    "pinhole": Lens(1280, 1024, 1400.0, 1400.0, 640.0, 512.0),
}
each_lens = pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)


def points_before(n=200, half_angle=0.5):
    rng = np.random.default_rng(5)
    x, y = np.tan(half_angle * (2 * rng.random((2, n)) - 1))
    z = 200 + 800 * rng.random(n)
    points = np.stack([x * z, y * z, z])
    points[:2, 0] = 0.0  # on the axis
    return points


@each_lens
def test_derivatives_are_difference_quotients(lens):
    points = points_before()
    pixels, by_point, by_intrinsics = lens.project_with_derivatives(points)
    np.testing.assert_array_equal(pixels, lens.project(points))
    for axis in range(3):
        step = np.zeros((3, 1))
        step[axis] = 1e-3  # mm: truncation 1e-9 px/mm, rounding 1e-10
        quotient = (lens.project(points + step) - lens.project(points - step)) / 2e-3
        np.testing.assert_allclose(by_point[:, axis], quotient, atol=1e-7)  # px/mm
    values = lens.intrinsics
    for k, name in enumerate(lens.names):
        step = np.zeros(len(values))
        step[k] = 1e-3 if k < 4 else 1e-6
        lower, upper = (lens.with_intrinsics(values + sign * step).project(points) for sign in (-1, 1))
        # Rounding of 1e-13 of a thousand pixels over the step.
        np.testing.assert_allclose(
            by_intrinsics[:, k], (upper - lower) / (2 * step[k]), atol=1e-4, rtol=1e-6, err_msg=name
        )


@each_lens
def test_pixels_are_those_of_opencv(lens):
    cv2 = pytest.importorskip("cv2", reason="opencv-python-headless is not installed")
    points, zero = points_before(), np.zeros(3)
    if lens.kind == "fisheye":
        theirs, jacobian = cv2.fisheye.projectPoints(points.T[None], zero, zero, lens.matrix, lens.coefficients)
    else:
        theirs, jacobian = cv2.projectPoints(points.T[:, None], zero, zero, lens.matrix, lens.coefficients)
    pixels, by_point, by_intrinsics = lens.project_with_derivatives(points)
    np.testing.assert_allclose(pixels.T, theirs.reshape(-1, 2), atol=1e-9)  # px: both in double
    if lens.kind == "brown":  # columns: rotation, translation, f, c, distortion
        rows = jacobian.reshape(-1, 2, jacobian.shape[1]).transpose(1, 2, 0)
        np.testing.assert_allclose(by_point, rows[:, 3:6], atol=1e-9)
        np.testing.assert_allclose(by_intrinsics, rows[:, 6:], atol=1e-7, rtol=1e-9)


@each_lens
def test_directions_of_pixels_are_those_that_were_projected(lens):
    points = points_before()
    np.testing.assert_allclose(lens.normalized(lens.project(points)), points[:2] / points[2], atol=1e-11)


def test_what_is_behind_the_camera_or_beyond_its_distortion_is_not_seen():
    lens = LENSES["brown"]
    assert np.isnan(lens.project([[0.0], [0.0], [-100.0]])).all()
    assert lens.sees([[0.0, 0.0, 900.0], [0.0, 0.0, 0.0], [500.0, -500.0, 500.0]]).tolist() == [True, False, False]
    folded = Lens(1280, 1024, 1400.0, 1400.0, 640.0, 512.0, "brown", [-0.4, 0.0, 0.0, 0.0, 0.0])
    # The image of x / z = 1.3 lies inside, 422 px off the centre, as that of 0.34 does.
    assert folded.sees([[0.34, 1.3], [0.0, 0.0], [1.0, 1.0]]).tolist() == [True, False]


@each_lens
def test_a_camera_file_comes_back_the_same(lens, tmp_path):
    file = tmp_path / "camera.yaml"
    file.write_text(camera_yaml(lens, notes=["u of fx: 0.3 px"]))
    read = read_camera(file)
    assert (read.kind, read.width, read.height, read.names) == (lens.kind, lens.width, lens.height, lens.names)
    np.testing.assert_array_equal(read.intrinsics, lens.intrinsics)


ECHO = b"""header:
  frame_id: camera_optical
height: 480
width: 640
distortion_model: plumb_bob
d:
- 0.1
- -0.2
- 0.001
- 0.002
k: [600.0, 0.0, 320.0, 0.0, 601.0, 240.0, 0.0, 0.0, 1.0]
p: [590.0, 0.0, 321.0, 0.0, 0.0, 591.0, 241.0, 0.0, 0.0, 0.0, 1.0, 0.0]
---
"""


def test_a_message_of_ros_is_read_with_k_and_d():
    lens = parse_camera(ECHO)
    np.testing.assert_array_equal(lens.intrinsics, [600, 601, 320, 240, 0.1, -0.2, 0.001, 0.002, 0])


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (b"plumb_bob", b"magic", "expected a distortion model out of plumb_bob"),
        (b"k: [600.0", b"k: [0.0", "states no calibration"),
        (b"k: [600.0", b"k: [-600.0", "expected positive focal lengths"),
        (b"k: [600.0", b"k: [.nan", "finite number"),
        (b"- 0.002\n", b"- 0.002\n- 1\n- 2\n", "list of 0 or 4 or 5 or 8 numbers"),
        (b"width: 640", b"width: 64", "is not in an image of 64 x 480 px"),
        (b"width: 640", b"width: 99999999", "1 to 30000 px"),
        (b"width: 640", b"breadth: 640", "image_width"),
        (b"plumb_bob", b"!!python/object plumb_bob", "tags are not read"),
    ],
)
def test_other_files_are_refused(old, new, problem):
    assert old in ECHO
    with pytest.raises(InputError, match=problem):
        parse_camera(ECHO.replace(old, new))
