"""Tables of other programs: which columns hold what, in which unit, and names in two spellings."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

import truearm as ta
from benchmarks.mistakes import mistake, right, seen
from benchmarks.rows import scratch
from truearm.arm import Arm, load_arm
from truearm.readings import Session
from truearm.typing import FloatArray
from truearm.wings.importing.foreign import JointScale, TableColumns, import_points

Columns = Mapping[str, FloatArray | Sequence[str]]
N = 24
_NUMBERS = itertools.count(1)
_random = np.random.default_rng(40)
ARM = load_arm("ur5e")
ANGLES = _random.uniform(-1.5, 1.5, (N, 6))
IN_MM = ARM.forward(ANGLES).tip_in_base
TRACKER = IN_MM @ Rotation.from_euler("z", 0.4).as_matrix().T + [2000.0, 500.0, 300.0]


def joints(pattern: str = "J{} [deg]") -> Columns:
    """Joint angles, in rad where the pattern does not say deg."""
    unit = np.degrees if "deg" in pattern else np.asarray
    return {pattern.format(i + 1): column for i, column in enumerate(unit(ANGLES).T)}


def points(pattern: str = "{} [mm]", values: FloatArray = TRACKER, axes: str = "XYZ") -> Columns:
    """Points, in mm if `values` are."""
    return {pattern.format(axis): column for axis, column in zip(axes, values.T, strict=True)}


def new_file(ending: str, content: str | None = None) -> Path:
    """A file that no case has yet."""
    file = scratch() / f"tables-{next(_NUMBERS)}{ending}"
    if content is not None:
        file.write_text(content)
    return file


def table(*parts: Columns) -> Path:
    """A CSV file of columns."""
    file = new_file(".csv")
    pd.DataFrame({name: values for part in parts for name, values in part.items()}).to_csv(file, index=False)
    return file


def imported(*parts: Columns, options: Sequence[str] = ()) -> str:
    """What ``truearm import`` says of a table of these columns."""
    return seen("import", table(*parts), "--preview", *options)


def is_tracker(session: Session) -> bool:
    """Whether the points are those of the tracker [mm], to what the digits of a table round off."""
    return session.points is not None and bool(np.allclose(session.points, TRACKER, rtol=0, atol=1e-6))


# Which columns are the points ----------------------------------------------------------------------------------------


def _with_controllers(instrument: str) -> str:
    own = points("measured_{}", IN_MM / 1000, "xyz")
    of_instrument = points(f"{instrument}_{{}}", TRACKER / 1000, "xyz")
    options = ("--angle-unit", "rad", "--point-unit", "m")
    return imported(of_instrument, joints("measured_q{}"), own, options=options)


@mistake("points of a marker beside what the controller calls measured", said=r"marker_x.*; measured_x.*--point \S")
def marker_and_measured() -> str:
    return _with_controllers("marker")


@mistake("points of a tracker beside what the controller calls measured", said="2 sets of columns may be the points")
def tracker_and_measured() -> str:
    return _with_controllers("tracker")


@mistake("points of a camera beside what the controller calls measured", said="2 sets of columns may be the points")
def mocap_and_measured() -> str:
    return _with_controllers("mocap")


@mistake("points without a word beside those that the controller calls measured", said="2 sets of columns may be")
def plain_and_measured() -> str:
    parts = points("{}"), joints("measured_q{}"), points("measured_{}", IN_MM, "xyz")
    return imported(*parts, options=("--angle-unit", "rad"))


@right("points of a tracker beside the pose that the controller displays", unsaid="2 sets")
def tracker_and_displayed() -> str:
    return imported(joints(), points("{}", IN_MM), points("tracker_{}", axes="xyz"))


@right("measured points beside those without a word", unsaid="2 sets")
def measured_and_plain() -> str:
    return imported(joints(), points("{}", IN_MM), points("{}_measured"))


@right("measured points beside nominal ones", unsaid="2 sets")
def measured_and_nominal() -> str:
    return imported(joints(), points("{} nominal", IN_MM), points("{} measured"))


@mistake("a column of points for the payload too", said="used for two things")
def one_column_twice() -> str:
    return imported(joints(), points("{}"), options=("--point", "X,Y,Z", "--column", "payload_kg=X"))


# Units ---------------------------------------------------------------------------------------------------------------


def _is_read(pattern: str, mm: float) -> bool:
    columns = points(pattern, TRACKER / mm)
    session = ta.import_table(table(joints(), columns), TableColumns(points=tuple(columns)))
    return is_tracker(session) and bool(np.allclose(import_points(table(columns), tuple(columns)), TRACKER, atol=1e-6))


@mistake("points in cm by their names, and named by hand")
def named_cm() -> bool:
    return _is_read("{} cm", 10.0)


@mistake("points in inches by their names, and named by hand")
def named_inches() -> bool:
    return _is_read("{} in", 25.4)


@mistake("points in metres by their names, and named by hand")
def named_metres() -> bool:
    return _is_read("{}_LT_m", 1000.0)


@mistake("points in inches by the header, in mm by the option", said="table states in, --point-unit states mm")
def inches_and_option() -> str:
    return imported(joints(), points("{} [in]", TRACKER / 25.4), options=("--point-unit", "mm"))


@mistake("angles in degrees by the header, in rad by the option", said="table states deg, --angle-unit states rad")
def degrees_and_option() -> str:
    return imported(joints(), points(), options=("--angle-unit", "rad"))


@right("points in mm by a header that is wrong, in metres by the option")
def wrong_header() -> bool:
    columns = table(joints(), points("{} [mm]", TRACKER / 1000))
    return is_tracker(ta.import_table(columns, point_unit="m"))


@right("points with _m for measured, in mm by the option")
def measured_m() -> bool:
    return is_tracker(ta.import_table(table(joints(), points("{}_m")), point_unit="mm"))


@right("angles in degrees by a header that is wrong, in rad by the option")
def wrong_header_of_angles() -> bool:
    columns = {f"J{i + 1} [deg]": column for i, column in enumerate(ANGLES.T)}
    session = ta.import_table(table(columns, points()), scale=JointScale("rad"))
    return bool(np.allclose(session.angles, ANGLES, rtol=0, atol=1e-9))


CELLS = tuple(f"a{i}{j}" for i in range(3) for j in range(4))


def _matrices(mm: float) -> Columns:
    pose = np.concatenate([np.tile(np.eye(3), (N, 1, 1)), TRACKER[:, :, None] / mm], axis=2)
    return dict(zip(CELLS, pose.reshape(N, 12).T, strict=True))


@mistake("points in metres in the last column of matrices", said="span .* may be mm or m.*--point-unit m")
def matrix_in_metres() -> str:
    return imported(joints(), _matrices(1000.0), options=("--orientation", ",".join(CELLS)))


@right("points in mm in the last column of matrices", unsaid="may be mm or m")
def matrix_in_mm() -> str:
    return imported(joints(), _matrices(1.0), options=("--orientation", ",".join(CELLS)))


@right("points in metres in the last column of matrices, and the option")
def matrix_and_option() -> bool:
    columns = TableColumns(orientation=CELLS)
    return is_tracker(ta.import_table(table(joints(), _matrices(1000.0)), columns, point_unit="m"))


# Names ---------------------------------------------------------------------------------------------------------------


@mistake("the tip named by a column nest, which is taken for the seat too")
def tip_in_nest() -> bool:
    nests = {"nest": ["N1", "N2", "N3"] * (N // 3)}
    session = ta.import_table(table(nests, joints(), points()), TableColumns(others={"tip": "nest"}))
    return session.seat is None and session.tip is not None


def _named(column: str, names: Sequence[str], one: str) -> str:
    written = [*names] * (N // len(names))
    written[5] = one
    return imported(joints(), points(), {column: written})


@mistake("a seat B1A among seats B1a", said=r"Seat 'B1A' \(1 reading\) may be 'B1a' \(11 readings\)")
def seat_in_capitals() -> str:
    return _named("seat", ["B1b", "B1a"], "B1A")


@mistake("a tip with a blank in its name in one row", said=r"Tip 'N 2' \(1 reading\) may be 'N2'")
def tip_with_a_blank() -> str:
    return _named("tip", ["N1", "N2"], "N 2")


@mistake("a seat with one reading, which no reading of another seat is tied to", said="Seat 'C' has a single reading")
def seat_with_one_reading() -> str:
    frame = ta.simulate("ur10", poses=20, seed=2).session.to_frame().assign(seat="")
    frame.loc[7, "seat"] = "C"
    return str(ta.fit("ur10", Session.from_frame(frame), model="nominal"))


@right("seats whose numbers read alike", unsaid="may be|single reading")
def seats_alike() -> str:
    return _named("seat", ["1 1", "11", "1-1", "A1"], "11")


# Which columns are joints --------------------------------------------------------------------------------------------


def _log(name: str, **arrays: FloatArray) -> Path:
    file = new_file(f"-{name}.npz")
    np.savez(file, **arrays)
    return file


def _quaternions() -> FloatArray:
    return Rotation.random(N, rng=np.random.default_rng(1)).as_quat()


@mistake("a quaternion q of a tracker's log, taken for four joints", said="no joint angles but a quaternion: its rows")
def quaternion_for_joints() -> str:
    return seen("import", _log("tracker", q=_quaternions(), p=TRACKER), "--angle-unit", "rad", "--preview")


@mistake("a part of the robot's log, and a tracker's log with an array of that name")
def part_of_each() -> bool:
    robot = _log("robot", q=ANGLES, unused=np.zeros((N - 1, 2)))
    tracker = _log("tracker", q=_quaternions(), p=TRACKER)
    scale = JointScale("rad")
    return all(
        is_tracker(ta.import_table(robot, scale=scale, points_from=tracker, part=part)) for part in ("q", ["q", "p"])
    )


def _without_j3(*, other: bool) -> str:
    columns = {name: values for name, values in joints().items() if "3" not in name}
    if other:
        return seen("import", table(columns), "--with", table(points()), "--preview")
    return imported(columns, points())


@mistake("the column of J3 was lost", said=r"J3 \[deg\] is missing.*--angles")
def lost_joint() -> str:
    return _without_j3(other=False)


@mistake("the column of J3 was lost, and the points are in a table of their own", said=r"J3 \[deg\] is missing")
def lost_joint_of_two_tables() -> str:
    return _without_j3(other=True)


@right("four joints q in rad", unsaid="quaternion|missing")
def four_joints() -> str:
    columns = {f"q[{i}]": column for i, column in enumerate(ANGLES.T[:4])}
    return imported(columns, points(), options=("--angle-unit", "rad"))


@right("three joints J1, J2, J4, named by hand", unsaid="missing")
def three_joints() -> str:
    columns = {f"J{i} [deg]": np.degrees(ANGLES[:, i - 1]) for i in (1, 2, 4)}
    return imported(columns, points(), options=("--angles", ",".join(columns)))


# Form ----------------------------------------------------------------------------------------------------------------


@right("a header that ends in a separator behind a name that no row fills", unsaid="fault of the program")
def open_header() -> str:
    header, *rows = table(joints(), points()).read_text().splitlines()
    return seen("import", new_file(".csv", "\n".join([f"{header},Comment,", *rows])), "--preview")


JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3}"/><axis xyz="{4}"/>'
    '<limit lower="-2" upper="2" effort="1" velocity="1"/>{5}</joint>'
)


def _parallelogram() -> Path:
    """A URDF with an empty first line, of an arm whose third joint mimics the second: it has no encoder."""
    rows = (
        ("j1", "w", "a", "0 0 0.3", "0 0 1", ""),
        ("j2", "a", "b", "0.1 0 0", "0 1 0", ""),
        ("j2p", "b", "c", "0.25 0 0", "0 1 0", '<mimic joint="j2" multiplier="-1"/>'),
        ("j3", "c", "d", "0.2 0 0.1", "0 0 1", ""),
        ("j4", "d", "e", "0.05 0.02 0.01", "0 1 0", ""),
    )
    links = "".join(f'<link name="{name}"/>' for name in "wabcde")
    body = f'<robot name="para">{links}{"".join(JOINT.format(*row) for row in rows)}</robot>'
    return new_file(".urdf", f'\n<?xml version="1.0"?>\n{body}')


@right("a URDF with an empty first line", unsaid="not valid XML")
def blank_first_line() -> str:
    return seen("arms", _parallelogram())


def _readings_of_parallelogram(j2p: float) -> tuple[Arm, Session]:
    """Readings with a constant in the column of the joint that has no encoder."""
    arm, rng = load_arm(_parallelogram()), np.random.default_rng(6)
    q = rng.uniform(-1, 1, (80, 5))
    q[:, 2] = j2p
    return arm, Session(q, arm.forward(q).tip_in_base + rng.normal(0, 0.02, (80, 3)))


@right("a network of an arm with a parallelogram, whose joint has no encoder", unsaid="does not move|moves by less")
def network_of_parallelogram() -> str:
    return str(ta.fit(*_readings_of_parallelogram(0.0), model="network", hidden=(4,), epochs=10))


@right("another log of that arm, with other numbers for the joint without encoder", unsaid="outside the trained")
def another_log_of_parallelogram() -> str:
    model = ta.fit(*_readings_of_parallelogram(0.0), model="nominal").model
    return str(ta.predict(model, _readings_of_parallelogram(0.5)[1]))
