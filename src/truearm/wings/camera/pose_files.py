"""Files of robots and boards: samples of easy_handeye and MoveIt, poses of industrial_calibration, OpenCV, tables."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from pathlib import Path
from typing import Any, Literal
from zipfile import BadZipFile, ZipFile, is_zipfile

import numpy as np
from scipy.spatial.transform import Rotation

from truearm.errors import InputError
from truearm.files.delimited import Sheet, as_utf8, form_of, read_columns
from truearm.files.file_reading import read_limited, recognise_encoding
from truearm.files.foreign_documents import YamlNode, parse_yaml
from truearm.readings.columns import ANGLE, FACTOR
from truearm.typing import FloatArray, IntArray

# Names that people know, and what they mean. Small letters: about fixed axes; capitals: about the turned ones.
ALIASES = {"rpy": "xyz:rad", "kuka": "ZYX:deg", "fanuc": "xyz:deg", "ur": "rotvec:rad"}
QUATERNIONS = ("xyzw", "wxyz")
# A quaternion or a matrix that is farther from a rotation is in another order, or no rotation.
ROUNDED = 0.02


def _euler_orders() -> list[str]:
    proper = ["".join(one) for one in permutations("xyz")]
    repeated = [a + b + a for a, b in permutations("xyz", 2)]
    return [*proper, *repeated, *map(str.upper, (*proper, *repeated))]


THREE = [f"{order}:{unit}" for order, unit in product(("rotvec", *_euler_orders()), ("deg", "rad"))]
FORMS = (*QUATERNIONS, "matrix", *THREE, *ALIASES)


def checked_form(text: str) -> str:
    """The form that a person names, without aliases.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if text not in FORMS:
        hint = "xyzw, wxyz, matrix, rotvec:rad, ZYX:deg (turned axes), xyz:rad (fixed axes), rpy, kuka, fanuc, ur"
        raise InputError(f"expected a form of rotations, got {text!r}", hint=hint)
    return ALIASES.get(text, text)


def read_rotations(numbers: FloatArray, form: str) -> Rotation | None:
    """The rotations of numbers (n, 3), (n, 4) or (n, 9) in a form; None if they are none in it."""
    if form in QUATERNIONS:
        is_unit = np.abs(np.linalg.norm(numbers, axis=1) - 1) < ROUNDED
        return Rotation.from_quat(numbers, scalar_first=form == "wxyz") if is_unit.all() else None
    if form == "matrix":
        R = numbers.reshape(-1, 3, 3)
        off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        return Rotation.from_matrix(R) if ((off < ROUNDED) & (np.linalg.det(R) > 0)).all() else None
    order, _, unit = form.partition(":")
    angles = np.radians(numbers) if unit == "deg" else numbers
    if np.abs(angles).max() > 2 * np.pi * 1.01:  # degrees, taken for radians
        return None
    return Rotation.from_rotvec(angles) if order == "rotvec" else Rotation.from_euler(order, angles)


def forms_of(numbers: FloatArray) -> dict[str, Rotation]:
    """All rotations that numbers may mean, by their forms; of forms that mean the same the first."""
    names = {4: QUATERNIONS, 9: ("matrix",), 3: tuple(THREE)}.get(numbers.shape[1], ())
    return {name: read for name in names if (read := read_rotations(numbers, name)) is not None}


def described(form: str) -> str:
    """A form in words."""
    if form in QUATERNIONS:
        return f"quaternions in the order {', '.join(form)}"
    if form == "matrix":
        return "matrices"
    order, _, unit = form.partition(":")
    if order == "rotvec":
        return f"rotation vectors in {unit}"
    axes = "fixed" if order.islower() else "turned"
    return f"Euler angles in {unit} about the {axes} axes {', '.join(order.lower())}"


Unit = Literal["mm", "m"]
MAX_BYTES = 50_000_000
SUPPORTED = (
    "a table with columns such as x_mm, y_mm, z_mm, qx, qy, qz, qw and q1_deg ..; samples of easy_handeye; pairs of "
    "MoveIt (.json); poses of industrial_calibration (.yaml); arrays of OpenCV (.npz)"
)
# What begins the columns of the robot's poses in a table, and those of the board's.
OF_ROBOT = ("flange_", "robot_", "tcp_", "tool_", "base_", "gripper_", "ee_")
OF_BOARD = ("board_", "camera_", "cam_", "marker_", "target_", "tag_")
# Columns of a rotation: their names without unit, and what they are without doubt.
ROTATIONS: dict[tuple[str, ...], str | None] = {
    ("quat_w", "quat_x", "quat_y", "quat_z"): "wxyz",
    ("qx", "qy", "qz", "qw"): "xyzw",
    tuple(f"r{i}{j}" for i in "123" for j in "123"): "matrix",
    ("rvec_x", "rvec_y", "rvec_z"): "rotvec:rad",
    ("roll", "pitch", "yaw"): "xyz",
    ("rx", "ry", "rz"): None,
    ("a", "b", "c"): None,
    ("w", "p", "r"): None,
}
_ROBOT_KEYS = r"(gripper|flange|tool|tcp|ee|eef|end|hand|robot)\w*2base|base_T?_?(gripper|flange|ee|tcp)"
_BOARD_KEYS = r"(target|board|marker|tag|object)\w*2cam(era)?|cam(era)?_T?_?(target|board|marker|tag)"


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses as a file has them.

    Attributes
    ----------
    positions : (n, 3) array
        In their own unit.
    forms : dict of str to Rotation
        The rotations that their numbers may be, by form.
    unit : {"mm", "m"} or None
        Of the positions; None where the file does not state it.
    form : str or None
        Which of the forms the file states.
    """

    positions: FloatArray
    forms: dict[str, Rotation]
    unit: Unit | None = None
    form: str | None = None

    def inverted(self) -> Poses:
        """The inverse poses, of the form that is stated, or of the only one.

        Raises
        ------
        InputError
            If there are several.
        """
        form = self.form or next(iter(self.forms), "")
        if (self.form is None and len(self.forms) > 1) or form not in self.forms:
            raise InputError("inverted poses need the form of their rotations", hint="--rotation FORM")
        back = self.forms[form].inv()
        return replace(self, positions=-back.apply(self.positions), forms={form: back}, form=form)

    @classmethod
    def of_motions(cls, T: FloatArray, unit: Unit | None) -> Poses:
        """Of (n, 4, 4) motions."""
        return cls(T[:, :3, 3], forms_of(T[:, :3, :3].reshape(-1, 9)), unit, "matrix")


@dataclass(frozen=True, eq=False)
class Samples:
    """What a file has of each image.

    Attributes
    ----------
    file : Path or None
    kind : str
        What the file is, in words.
    joints : (n, n_joints) array or None
        [rad, or mm].
    robot, board : Poses or None
        Of the flange in the base, of the board in the camera.
    eye_in_hand : bool or None
        Where the camera is; None where the file does not state it.
    inverts_standing : bool
        Of easy_handeye: the poses are of the base in the flange where the camera stands.
    lines : (n,) int array or None
        Lines of the images in a table.
    """

    file: Path | None
    kind: str
    joints: FloatArray | None = None
    robot: Poses | None = None
    board: Poses | None = None
    eye_in_hand: bool | None = None
    inverts_standing: bool = False
    lines: IntArray | None = None

    def __len__(self) -> int:
        parts = (self.joints, *(None if one is None else one.positions for one in (self.robot, self.board)))
        return max((len(one) for one in parts if one is not None), default=0)

    def called(self, row: int) -> str:
        """An image as people find it in the file."""
        return f"image {row + 1}" if self.lines is None else f"line {self.lines[row]}"


def read_samples(path: str | Path) -> Samples:
    """Read a file of robots and boards, recognised by what is in it.

    Raises
    ------
    InputError
        If it is none that is known, or breaks a rule of its kind.
    """
    file = Path(path)
    data = read_limited(file, limit_bytes=MAX_BYTES)
    with InputError.of_file(file):
        if data[:2] == b"PK" and is_zipfile(io.BytesIO(data)) and file.suffix != ".xlsx":
            return replace(_of_opencv(data), file=file)
        text = data.lstrip()[:1]
        if file.suffix.lower() == ".json" or text in (b"[", b"{"):
            return replace(_of_json(data), file=file)
        if file.suffix.lower() in (".yaml", ".yml", ".samples"):
            return replace(_of_yaml(parse_yaml(data), file), file=file)
        return replace(_of_table(data, file), file=file)


# OpenCV's arrays ------------------------------------------------------------------------------------------------------


def _of_opencv(data: bytes) -> Samples:
    try:
        with ZipFile(io.BytesIO(data)) as packed:
            if sum(one.file_size for one in packed.infolist()) > MAX_BYTES:
                raise InputError(f"expected at most {MAX_BYTES} bytes of arrays")
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            found = {name: np.asarray(arrays[name], dtype=float) for name in arrays.files}
    except (BadZipFile, ValueError, OSError, TypeError) as error:
        raise InputError(f"the file is no npz with arrays of numbers ({str(error)[:80]})", hint=SUPPORTED) from None
    robot, board = (_poses_among(found, key) for key in (_ROBOT_KEYS, _BOARD_KEYS))
    joints = None
    for name, values in found.items():
        if re.search(r"joint|^q(_|$)", name.lower()) and values.ndim == 2:
            unit = re.search(r"deg|rad", name.lower())
            if unit is None:
                raise InputError(f"the unit of {name} is not stated", column=name, hint="call it joints_rad")
            joints = values * FACTOR[unit[0]]
    if robot is None and board is None and joints is None:
        hint = "R_gripper2base, t_gripper2base, R_target2cam, t_target2cam, joints_deg"
        raise InputError(f"expected arrays of poses, got {', '.join(found)[:100]}", hint=hint)
    return Samples(None, "arrays of OpenCV", joints, robot, board)


def _poses_among(arrays: dict[str, FloatArray], key: str) -> Poses | None:
    """The poses whose names match: 4 x 4 motions, or rotations and translations."""
    of = {name: values for name, values in arrays.items() if re.search(key, name, re.IGNORECASE)}
    for name, values in of.items():
        if values.ndim == 3 and values.shape[1:] == (4, 4):
            return Poses.of_motions(values, _unit_in(name))
    rotation = next((one for name, one in of.items() if re.match(r"(?i)r", name)), None)
    moved = next(((name, one) for name, one in of.items() if re.match(r"(?i)t", name)), None)
    if rotation is None or moved is None:
        return None
    name, positions = moved[0], moved[1].reshape(len(moved[1]), -1)
    numbers = rotation.reshape(len(rotation), -1)
    if positions.shape[1:] != (3,) or numbers.shape[1] not in (3, 4, 9) or len(numbers) != len(positions):
        raise InputError(f"expected rotations and translations of as many images, got shapes {rotation.shape} and "
                         f"{moved[1].shape}", column=name)  # fmt: skip
    form = {3: "rotvec:rad", 9: "matrix"}.get(numbers.shape[1])
    return Poses(positions, forms_of(numbers), _unit_in(name), form)


def _unit_in(name: str) -> Unit | None:
    return "mm" if re.search(r"_mm$", name) else "m" if re.search(r"_m$", name) else None


# ROS's files ----------------------------------------------------------------------------------------------------------


def _of_json(data: bytes) -> Samples:
    try:
        root: Any = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise InputError(f"the file is no JSON ({str(error)[:80]})") from None
    if isinstance(root, dict):
        root = next((one for one in root.values() if isinstance(one, list)), None)
    if not isinstance(root, list):
        raise InputError("expected a list of pairs of 4 x 4 motions, as MoveIt writes it", hint=SUPPORTED)
    pairs = [
        [one.get(key) for key in ("effector_wrt_world", "object_wrt_sensor")] if isinstance(one, dict) else one
        for one in root
    ]
    return _of_pairs(pairs)


def _of_pairs(pairs: Iterable[Any]) -> Samples:
    """Pairs of the flange in the base and the board in the camera, 4 x 4 in m: MoveIt."""
    read = []
    for number, pair in enumerate(pairs, start=1):
        try:
            both = np.array([np.array(one, dtype=float).reshape(4, 4) for one in pair])
        except (TypeError, ValueError):
            both = np.zeros(0)
        if both.shape != (2, 4, 4) or not np.isfinite(both).all():
            raise InputError(f"expected two 4 x 4 motions in pair {number}: effector in base, object in sensor")
        read.append(both)
    if not read:
        raise InputError("expected pairs of motions, got none")
    T = np.stack(read)
    return Samples(None, "pairs of MoveIt", None, Poses.of_motions(T[:, 0], "m"), Poses.of_motions(T[:, 1], "m"))


def _of_yaml(root: YamlNode, file: Path) -> Samples:
    entries = root.entries or {}
    if (samples := entries.get("samples")) is not None and samples.items is not None:
        return _of_easy_handeye(entries, samples.items)
    if "camera_marker_samples" in entries and "hand_world_samples" in entries:
        of = [_listed(entries[name], "transforms") for name in ("hand_world_samples", "camera_marker_samples")]
        robot, board = (_transforms(nodes) for nodes in of)
        return Samples(None, "samples of easy_handeye", None, robot, board, inverts_standing=True)
    nodes = root.items if root.items is not None else next((one.items for one in entries.values() if one.items), None)
    if not nodes:
        raise InputError("expected samples or poses, got another YAML file", hint=SUPPORTED)
    first = nodes[0].entries or {}
    if "effector_wrt_world" in first:
        keys = ("effector_wrt_world", "object_wrt_sensor")
        return _of_pairs([[_floats((one.entries or {}).get(key)) for key in keys] for one in nodes])
    if "pose" in first:  # a list of images and files of poses
        files = [(one.entries or {}).get("pose") for one in nodes]
        read = [_pose_file(file.parent / (one.text or "")) for one in files if one is not None]
        return Samples(None, "poses of industrial_calibration", None, _flat(read))
    return Samples(None, "poses of industrial_calibration", None, _flat(nodes))


def _pose_file(file: Path) -> YamlNode:
    with InputError.of_file(file):
        return parse_yaml(read_limited(file, limit_bytes=10_000))


def _of_easy_handeye(entries: dict[str, YamlNode], samples: Sequence[YamlNode]) -> Samples:
    parameters = (entries["parameters"].entries if "parameters" in entries else None) or {}
    kind = next((parameters[key].text for key in ("calibration_type", "eye_on_hand") if key in parameters), None)
    eye_in_hand = {"eye_in_hand": True, "true": True, "eye_on_base": False, "false": False}.get((kind or "").lower())
    sides = [[_side(one, *names) for one in samples] for names in (("robot",), ("tracking", "optical"))]
    robot, board = (_transforms(nodes) for nodes in sides)
    return Samples(None, "samples of easy_handeye", None, robot, board, eye_in_hand, inverts_standing=True)


def _side(sample: YamlNode, *names: str) -> YamlNode:
    found = next((one for name, one in (sample.entries or {}).items() if name in names), None)
    if found is None:
        raise InputError(f"expected a sample with robot and tracking, {names[0]} is missing", line=sample.line)
    return (found.entries or {}).get("transform", found)


def _listed(node: YamlNode, key: str) -> list[YamlNode]:
    return (node.entries or {}).get(key, node).items or []


def _transforms(nodes: Iterable[YamlNode]) -> Poses:
    """Transforms of ROS: translation [m] and quaternion."""
    read = []
    for node in nodes:
        of = node.mapping("a transform", required=("translation", "rotation"))
        where = of["translation"].mapping("a translation", required=("x", "y", "z"))
        turned = of["rotation"].mapping("a quaternion", required=("x", "y", "z", "w"))
        read.append([part[name].number(name) for part, names in ((where, "xyz"), (turned, "xyzw")) for name in names])
    return _checked(np.array(read))


def _flat(nodes: Iterable[YamlNode]) -> Poses:
    """Poses with x, y, z [m], qx, qy, qz, qw."""
    names = ("x", "y", "z", "qx", "qy", "qz", "qw")
    read = [[node.mapping("a pose", required=names)[name].number(name) for name in names] for node in nodes]
    return _checked(np.array(read))


def _checked(numbers: FloatArray) -> Poses:
    if not len(numbers):
        raise InputError("expected poses, got none")
    found = Poses(numbers[:, :3], forms_of(numbers[:, 3:]), "m", "xyzw")
    if "xyzw" not in found.forms:
        raise InputError("expected quaternions of length 1")
    return found


def _floats(node: YamlNode | None) -> list[float]:
    flat = [] if node is None else node.items or []
    nested = [inner for one in flat for inner in (one.items or [one])]
    return [one.number("a number of a motion") for one in nested]


# Tables ---------------------------------------------------------------------------------------------------------------


def _of_table(data: bytes, file: Path) -> Samples:
    sheet = _sheet(data, file)
    names = [name.lower() for name in sheet.names]
    angles = [i for i, name in enumerate(names) if ANGLE.fullmatch(name)]
    robot = _columns(names, OF_ROBOT)
    board = _columns(names, ("", *OF_BOARD))
    if not angles and robot is None and board is None:
        if (bare := _bare(sheet)) is None:
            raise sheet.error("expected columns of poses or joints", hint=SUPPORTED)
        board = bare
    needed = [*angles, *(i for part in (robot, board) if part is not None for i in part.all)]
    numbers, _ = read_columns(sheet, needed)
    at = {column: k for k, column in enumerate(needed)}

    def poses(part: _Columns | None) -> Poses | None:
        return None if part is None else part.poses(lambda columns: numbers[:, [at[i] for i in columns]])

    factors = [FACTOR[ANGLE.fullmatch(names[i])[2]] for i in angles]  # type: ignore[index]
    joints = numbers[:, : len(angles)] * factors if angles else None
    lines = sheet.first_line + np.arange(len(numbers))
    return Samples(None, "a table", joints, poses(robot), poses(board), lines=lines)


@dataclass(frozen=True)
class _Columns:
    """Where a pose is in a table."""

    position: tuple[int, ...]
    rotation: tuple[int, ...]
    unit: Unit | None
    form: str | None

    @property
    def all(self) -> tuple[int, ...]:
        return self.position + self.rotation

    def poses(self, numbers: Callable[[tuple[int, ...]], FloatArray]) -> Poses:
        found = Poses(numbers(self.position), forms_of(numbers(self.rotation)), self.unit, self.form)
        if self.form in ("deg", "rad"):  # the unit alone is stated
            kept = {form: R for form, R in found.forms.items() if form.endswith(self.form)}
            return replace(found, forms=kept, form=None)
        return found


def _columns(names: list[str], prefixes: Sequence[str]) -> _Columns | None:
    """The columns of a pose whose names begin with one of the prefixes."""
    for prefix in prefixes:
        own = {name.removeprefix(prefix): i for i, name in enumerate(names) if name.startswith(prefix)}
        for unit, ending in (("mm", "_mm"), ("m", "_m"), (None, "")):
            for axes in ("xyz", ("tx", "ty", "tz")):
                position = [own.get(f"{axis}{ending}") for axis in axes]
                if None in position:
                    continue
                for columns, form in ROTATIONS.items():
                    for of_unit in ("", "_deg", "_rad"):
                        rotation = [own.get(name + of_unit) for name in columns]
                        if None not in rotation:
                            stated = of_unit.removeprefix("_")
                            if form == "xyz" or (form is None and stated):
                                form = f"xyz:{stated}" if form and stated else stated or None
                            return _Columns(tuple(position), tuple(rotation), unit, form)  # type: ignore[arg-type]
    return None


def _sheet(data: bytes, file: Path) -> Sheet:
    """A table with a header, or of numbers alone; cells are separated by commas, semicolons, tabs or blanks."""
    text = as_utf8(data, file, recognise_encoding(data))
    head = text.decode().lstrip("\ufeff").splitlines()[:1]
    first = head[0] if head else ""
    if not any(sign in first for sign in ",;\t"):
        cells = first.split()
        bare = all(map(_is_number, cells))
        names = tuple(str(i + 1) for i in range(len(cells))) if bare else tuple(cells)
        return Sheet(file, names, 1 if bare else 2, first, " ", ".", text)
    sheet = form_of(data, file)
    if all(map(_is_number, sheet.names)):
        return replace(sheet, names=tuple(str(i + 1) for i in range(len(sheet.names))), first_line=1)
    return sheet


def _is_number(cell: str) -> bool:
    return re.fullmatch(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?", cell.strip()) is not None


def _bare(sheet: Sheet) -> _Columns | None:
    """A pose in columns without names: position and rotation, or three or four rows of a matrix."""
    n = len(sheet.names)
    if sheet.first_line != 1 or n not in (6, 7, 12, 16):
        return None
    if n in (12, 16):
        turned = tuple(4 * i + j for i in range(3) for j in range(3))
        return _Columns((3, 7, 11), turned, None, "matrix")
    return _Columns((0, 1, 2), tuple(range(3, n)), None, None)
