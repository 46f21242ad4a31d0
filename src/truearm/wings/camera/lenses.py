"""The camera model: a pinhole with the distortion of its lens, Brown's or that of a fisheye.

Frame of the camera, as OpenCV and the optical frames of ROS have it: x to the right, y down, z forward. The centre of
the first pixel is at (0, 0). Arrays have coordinates first and points last.

References
----------
D. C. Brown, "Close-range camera calibration", Photogrammetric Engineering 37 (1971) 855; with three more coefficients
OpenCV's and ROS's rational polynomial. J. Kannala, S. S. Brandt, "A generic camera model and calibration method for
conventional, wide-angle, and fish-eye lenses", IEEE PAMI 28 (2006) 1335: the equidistant model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.files.file_reading import parse_file
from truearm.files.foreign_documents import YamlNode, parse_yaml
from truearm.typing import BoolArray, FloatArray

LensKind = Literal["brown", "fisheye"]

PINHOLE = ("fx", "fy", "cx", "cy")
COEFFICIENTS: dict[LensKind, tuple[str, ...]] = {
    "brown": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "fisheye": ("k1", "k2", "k3", "k4"),
}
# How many of them a lens has: of Brown's model five or, with the rational polynomial, eight.
N_COEFFICIENTS: dict[LensKind, tuple[int, ...]] = {"brown": (5, 8), "fisheye": (4,)}
# ROS's names of the models. That of a fisheye has two.
_ROS: dict[str, LensKind] = {
    "plumb_bob": "brown",
    "rational_polynomial": "brown",
    "equidistant": "fisheye",
    "fisheye": "fisheye",
}
MAX_BYTES = 200_000
LARGEST_PX = 30_000
_STEPS = 50


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera: the size of its image and its intrinsics.

    Attributes
    ----------
    width, height : int
        Of the image [px].
    fx, fy, cx, cy : float
        Focal lengths and centre [px].
    kind : {"brown", "fisheye"}
    coefficients : (5,), (8,) or (4,) array
        Of the distortion: k1, k2, p1, p2, k3 (, k4, k5, k6) of Brown's model, k1 to k4 of a fisheye.

    Raises
    ------
    InputError
        If a number is not finite, a focal length is not positive, the centre is far outside the image, or the number
        of coefficients is another.

    Examples
    --------
    >>> from truearm.wings.camera.lenses import Lens
    >>> lens = Lens(1280, 1024, 1400.0, 1400.0, 640.0, 512.0)
    >>> lens.project([[10.0], [0.0], [500.0]]).ravel().tolist()
    [668.0, 512.0]
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    kind: LensKind = "brown"
    coefficients: npt.ArrayLike = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        coefficients = np.array(self.coefficients, dtype=float)
        coefficients.setflags(write=False)
        object.__setattr__(self, "coefficients", coefficients)
        numbers = N_COEFFICIENTS[self.kind]
        if coefficients.ndim != 1 or len(coefficients) not in numbers:
            raise InputError(f"expected {' or '.join(map(str, numbers))} coefficients of the {self.kind} distortion")
        if not (1 <= self.width <= LARGEST_PX and 1 <= self.height <= LARGEST_PX):
            raise InputError(f"expected an image of 1 to {LARGEST_PX} px a side, got {self.width} x {self.height}")
        if not np.isfinite(self.intrinsics).all():
            raise InputError("the intrinsics hold a number that is not finite")
        if not min(self.fx, self.fy) > 0:
            raise InputError(f"expected positive focal lengths, got {self.fx:g} and {self.fy:g} px")
        if abs(self.cx - self.width / 2) > self.width or abs(self.cy - self.height / 2) > self.height:
            raise InputError(
                f"the centre ({self.cx:.0f}, {self.cy:.0f}) px is not in an image of {self.width} x {self.height} px",
                hint="the camera's file is of another resolution",
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the intrinsics, in the order of `intrinsics`."""
        return PINHOLE + COEFFICIENTS[self.kind][: np.size(self.coefficients)]

    @property
    def intrinsics(self) -> FloatArray:
        """fx, fy, cx, cy and the coefficients, in one vector (p,)."""
        return np.array([self.fx, self.fy, self.cx, self.cy, *np.asarray(self.coefficients)])

    @property
    def matrix(self) -> FloatArray:
        """(3, 3) matrix K of the pinhole."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def with_intrinsics(self, values: FloatArray) -> Lens:
        """The camera with other intrinsics (p,), in the order of `names`."""
        fx, fy, cx, cy = values[:4].tolist()
        return replace(self, fx=fx, fy=fy, cx=cx, cy=cy, coefficients=values[4:])

    def project(self, points: npt.ArrayLike) -> FloatArray:
        """Pixels (2, n) of points (3, n) in the camera's frame, in any unit; NaN of points that are not in front."""
        return self._projected(np.asarray(points, dtype=float))[0]

    def project_with_derivatives(self, points: npt.ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pixels of points in the camera's frame, with what they change by.

        Parameters
        ----------
        points : (3, n) array
            [mm].

        Returns
        -------
        pixels : (2, n) array
            [px].
        by_point : (2, 3, n) array
            Derivatives by the coordinates of the points [px/mm].
        by_intrinsics : (2, p, n) array
            Derivatives by the intrinsics, in the order of `names`.
        """
        points = np.asarray(points, dtype=float)
        pixels, distorted, by_normal, inverse = self._projected(points)
        by_coefficient = self._by_coefficient(points[:2] * inverse)
        focal = np.array([self.fx, self.fy])
        by_normal *= focal[:, None, None]
        x, y = points[:2] * inverse
        by_point = np.empty((2, 3, points.shape[1]))
        by_point[:, :2] = by_normal * inverse
        by_point[:, 2] = -(by_normal[:, 0] * x + by_normal[:, 1] * y) * inverse
        by_intrinsics = np.zeros((2, 4 + by_coefficient.shape[1], points.shape[1]))
        for axis in (0, 1):
            by_intrinsics[axis, axis], by_intrinsics[axis, 2 + axis] = distorted[axis], 1.0
        by_intrinsics[:, 4:] = by_coefficient * focal[:, None, None]
        return pixels, by_point, by_intrinsics

    def sees(self, points: npt.ArrayLike) -> BoolArray:
        """Which points (3, n) are in front of the camera, in its image and within the range of its distortion."""
        pixels, _, by_normal, _ = self._projected(np.asarray(points, dtype=float))
        # Beyond its range a polynomial folds back: the image would show the point once more, mirrored.
        rises = by_normal[0, 0] * by_normal[1, 1] - by_normal[0, 1] * by_normal[1, 0] > 0
        size = np.array([[self.width], [self.height]])
        inside: BoolArray = ((pixels >= -0.5) & (pixels <= size - 0.5)).all(axis=0) & rises
        return inside

    def normalized(self, pixels: npt.ArrayLike) -> FloatArray:
        """Directions (x / z, y / z) (2, n) of pixels (2, n): the inverse of `project`; NaN where there is none."""
        pixels = np.asarray(pixels, dtype=float)
        wanted = (pixels - np.array([[self.cx], [self.cy]])) / np.array([[self.fx], [self.fy]])
        found = wanted.copy()
        if self.kind == "fisheye":  # the undistorted angle is the better start: the tangent is steep
            angle = np.hypot(*wanted)
            found *= np.where(angle > 1e-9, np.tan(np.minimum(angle, 1.5)) / np.maximum(angle, 1e-9), 1.0)
        for _ in range(_STEPS):
            distorted, by_normal = self._distorted(found)
            miss = distorted - wanted
            if not np.nanmax(np.abs(miss), initial=0.0) > 1e-13:
                break
            determinant = by_normal[0, 0] * by_normal[1, 1] - by_normal[0, 1] * by_normal[1, 0]
            step = np.stack(
                [
                    by_normal[1, 1] * miss[0] - by_normal[0, 1] * miss[1],
                    by_normal[0, 0] * miss[1] - by_normal[1, 0] * miss[0],
                ]
            )
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                step /= determinant
                longest = 0.5 * (1.0 + np.hypot(*found))  # a full step may leave the range of the polynomial
                found = found - step * np.minimum(1.0, longest / np.maximum(np.hypot(*step), 1e-300))
        with np.errstate(invalid="ignore", over="ignore"):
            missed = ~(np.abs(self._distorted(found)[0] - wanted) < 1e-9).all(axis=0)
        return np.where(missed, np.nan, found)

    def _projected(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Pixels, distorted directions, their derivatives by direction, and 1 / z."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            inverse = np.where(points[2] > 0, 1.0 / points[2], np.nan)
            distorted, by_normal = self._distorted(points[:2] * inverse)
        pixels = distorted * np.array([[self.fx], [self.fy]]) + np.array([[self.cx], [self.cy]])
        return pixels, distorted, by_normal, inverse

    def _distorted(self, normal: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distorted directions (2, n), and their derivatives (2, 2, n) by the direction."""
        return (_brown if self.kind == "brown" else _fisheye)(normal, np.asarray(self.coefficients, dtype=float))

    def _by_coefficient(self, normal: FloatArray) -> FloatArray:
        """Derivatives (2, p, n) of distorted directions by the coefficients."""
        by = _brown_by_coefficient if self.kind == "brown" else _fisheye_by_coefficient
        return by(normal, np.asarray(self.coefficients, dtype=float))


def _brown(normal: FloatArray, coefficients: FloatArray) -> tuple[FloatArray, FloatArray]:
    k1, k2, p1, p2, k3, *rational = coefficients.tolist()
    k4, k5, k6 = rational or (0.0, 0.0, 0.0)
    x, y = normal
    xx, yy, xy = x * x, y * y, x * y
    r2 = xx + yy
    above = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    below = 1 / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    radial = above * below
    # Derivative of the radial factor by r^2, twice: that by x is `slope * x`.
    slope = 2 * below * (k1 + r2 * (2 * k2 + 3 * r2 * k3) - radial * (k4 + r2 * (2 * k5 + 3 * r2 * k6)))
    distorted = radial * normal + np.stack([2 * p1 * xy + p2 * (r2 + 2 * xx), p1 * (r2 + 2 * yy) + 2 * p2 * xy])
    by_normal = np.empty((2, 2, normal.shape[1]))
    by_normal[0, 0] = radial + slope * xx + 2 * p1 * y + 6 * p2 * x
    by_normal[1, 1] = radial + slope * yy + 6 * p1 * y + 2 * p2 * x
    by_normal[0, 1] = by_normal[1, 0] = slope * xy + 2 * p1 * x + 2 * p2 * y
    return distorted, by_normal


def _brown_by_coefficient(normal: FloatArray, coefficients: FloatArray) -> FloatArray:
    k1, k2, _, _, k3, *rational = coefficients.tolist()
    k4, k5, k6 = rational or (0.0, 0.0, 0.0)
    x, y = normal
    xx, yy, xy = x * x, y * y, x * y
    r2 = xx + yy
    below = 1 / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    by_coefficient = np.empty((2, len(coefficients), normal.shape[1]))
    powers = np.stack([r2, r2 * r2, r2 * r2 * r2])
    by_coefficient[:, [0, 1, 4]] = normal[:, None] * (powers * below)
    by_coefficient[0, 2], by_coefficient[0, 3] = 2 * xy, r2 + 2 * xx
    by_coefficient[1, 2], by_coefficient[1, 3] = r2 + 2 * yy, 2 * xy
    if rational:
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) * below
        by_coefficient[:, 5:] = -normal[:, None] * (powers * radial * below)
    return by_coefficient


def _fisheye(normal: FloatArray, coefficients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """As `_brown`, of the equidistant model: an angle t from the axis is drawn at t (1 + k1 t^2 + .. + k4 t^8)."""
    r = np.hypot(*normal)
    small = r < 1e-6  # there tan t = t to rounding
    safe = np.where(small, 1.0, r)
    t = np.arctan(r)
    t2 = t * t
    powers = np.stack([t2, t2**2, t2**3, t2**4])
    polynomial = 1 + coefficients @ powers
    slope = 1 + (np.array([3.0, 5.0, 7.0, 9.0]) * coefficients) @ powers
    by_radius = np.where(small, 1.0, t / safe)
    scale = by_radius * polynomial
    # Derivative of the scale by the radius, over the radius.
    change = np.where(small, 0.0, (slope / (1 + r * r) - scale) / (safe * safe))
    by_normal = change * normal[:, None] * normal[None] + scale * np.eye(2)[:, :, None]
    return scale * normal, by_normal


def _fisheye_by_coefficient(normal: FloatArray, _: FloatArray) -> FloatArray:
    r = np.hypot(*normal)
    t = np.arctan(r)
    t2 = t * t
    by_radius = np.where(r < 1e-6, 1.0, t / np.where(r < 1e-6, 1.0, r))
    return np.asarray(normal[:, None] * (by_radius * np.stack([t2, t2**2, t2**3, t2**4])))


def read_camera(path: str | Path) -> Lens:
    """Read a camera's file: ROS's camera_info as its calibration writes it, or as ``ros2 topic echo`` prints it.

    K and D are read, which belong to the images as the camera takes them (image_raw). P belongs to rectified ones.

    Raises
    ------
    InputError
        If the file is missing or another, states no calibration (K is zero), or has another model of distortion.
    """
    return parse_file(path, parse_camera, limit_bytes=MAX_BYTES)


def parse_camera(content: bytes) -> Lens:
    """The camera of the content of a file; errors as of `read_camera`."""
    root = parse_yaml(content.rstrip().removesuffix(b"---"))  # with which `ros2 topic echo` ends a message
    if root.entries is None:
        raise InputError("expected ROS's camera_info, got no mapping", line=root.line)
    entries = {name.lower(): node for name, node in root.entries.items()}
    width, height = (_whole(_entry(entries, root, f"image_{name}", name), name) for name in ("width", "height"))
    K = _numbers(_entry(entries, root, "camera_matrix", "k"), "the camera matrix", (9,))
    if not K[0]:
        raise InputError(
            "the camera's file states no calibration: the camera matrix is zero",
            hint="calibrate the camera first, or omit --camera and let truearm identify the intrinsics",
        )
    node = _entry(entries, root, "distortion_coefficients", "d")
    model = entries.get("distortion_model")
    name = "plumb_bob" if model is None or not model.text else model.text
    if name not in _ROS:
        line = None if model is None else model.line
        raise InputError(f"expected a distortion model out of {', '.join(_ROS)}, got {name[:40]!r}", line=line)
    kind = _ROS[name]
    numbers = (0, 4, *N_COEFFICIENTS[kind])
    coefficients = _numbers(node, "the distortion coefficients", numbers)
    least = N_COEFFICIENTS[kind][0]
    coefficients += [0.0] * (least - len(coefficients))  # of Brown's model four are usual, without k3
    return Lens(width, height, K[0], K[4], K[2], K[5], kind, coefficients)


def camera_yaml(lens: Lens, *, name: str = "camera", notes: Sequence[str] = ()) -> str:
    """The camera as a file of ROS's camera_info; the notes are its first lines, as comments."""
    model = {5: "plumb_bob", 8: "rational_polynomial", 4: "equidistant"}[np.size(lens.coefficients)]
    K, D = lens.matrix, np.asarray(lens.coefficients)
    P = np.column_stack([K, np.zeros(3)])
    matrices = {
        "camera_matrix": K,
        "distortion_coefficients": D[None],
        "rectification_matrix": np.eye(3),
        "projection_matrix": P,
    }
    lines = [*(f"# {note}" for note in notes), f"image_width: {lens.width}", f"image_height: {lens.height}"]
    lines += [f"camera_name: {name}", f"distortion_model: {model}"]
    for key, matrix in matrices.items():
        lines += [f"{key}:", f"  rows: {matrix.shape[0]}", f"  cols: {matrix.shape[1]}"]
        lines.append(f"  data: [{', '.join(repr(value) for value in matrix.ravel().tolist())}]")
    return "\n".join(lines) + "\n"


def _entry(entries: dict[str, YamlNode], root: YamlNode, name: str, short: str) -> YamlNode:
    found = entries.get(name, entries.get(short))
    if found is None:
        raise InputError(
            f"expected ROS's camera_info with {name} (or {short}), which is missing",
            line=root.line,
            hint="image_width, image_height, camera_matrix, distortion_model, distortion_coefficients",
        )
    return found


def _whole(node: YamlNode, what: str) -> int:
    value = node.number(f"the image's {what}")
    if value != int(value):
        raise InputError(f"expected a whole number of pixels, got {value:g}", line=node.line)
    return int(value)


def _numbers(node: YamlNode, what: str, lengths: tuple[int, ...]) -> list[float]:
    if node.entries is not None and "data" in node.entries:
        node = node.entries["data"]
    if node.items is None or len(node.items) not in lengths:
        expected = " or ".join(map(str, lengths))
        raise InputError(f"expected {what} as a list of {expected} numbers", line=node.line)
    return [item.number(what) for item in node.items]
