"""A session: readings of an arm with base and reference unmoved, in files and data frames, and fair splits of it.

One thing may not have two spellings in it. Readings that are neighbours stay together in a split.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Self, get_args

import numpy as np

from truearm.errors import InputError
from truearm.findings import Finding
from truearm.readings.anchors import rows_with_distance
from truearm.readings.columns import data_frame, fields_of_frame, session_columns
from truearm.readings.files import read_fields, write_session
from truearm.readings.lengths import Lengths
from truearm.readings.readings import NAMED, Readings, folded_name
from truearm.readings.repeats import readings_of_one_pose
from truearm.typing import BoolArray, IntArray, NameArray

if TYPE_CHECKING:
    import pandas as pd

SplitBy = Literal["position", "seat", "session", "row"]

# Readings in a seat that determine the place of the seat and something of the arm as well.
READINGS_A_SEAT = 5
_MOST = 5  # names in a sentence


def doubtful_names(session: Session, lengths: Lengths | None) -> Iterator[Finding]:
    """`similar_names` and `single_seats`."""
    yield from similar_names(session)
    yield from single_seats(session, lengths)


def similar_names(session: Session) -> Iterator[Finding]:
    """A finding for each name that differs from a more frequent one of its column in case or blanks only."""
    for kind in NAMED:
        if (names := getattr(session, kind)) is None:
            continue
        spelled = defaultdict(list)
        for name, n in Counter(names[names != ""].tolist()).most_common():
            spelled[folded_name(name)].append(f"{name!r} ({n} reading{'s' * (n != 1)})")
        for usual, *others in spelled.values():
            for other in others:
                what = f"{kind.replace('_', ' ').capitalize()} {other} may be {usual}"
                said = f"{what}: the names differ in case or blanks only. Give one thing one name."
                yield Finding("similar names", said)


def single_seats(session: Session, lengths: Lengths | None) -> Iterator[Finding]:
    """A finding of seats with one reading that are not at the end of a known length: they tie no two poses."""
    if session.seat is None:
        return
    ends = [""] if lengths is None else ["", *lengths.seat_a.tolist(), *lengths.seat_b.tolist()]
    once = [repr(name) for name, n in Counter(session.seat.tolist()).items() if n == 1 and name not in ends]
    shown = ", ".join(once[:_MOST]) + f" and {len(once) - _MOST} more" * (len(once) > _MOST)
    if once:
        said = f"Seats {shown} have a single reading each" if len(once) > 1 else f"Seat {shown} has a single reading"
        yield Finding("single seats", f"{said}, which ties no two poses: ignored as a seat.", {"n": len(once)})


@dataclass(frozen=True, eq=False, repr=False)
class Session(Readings):
    """Readings of an arm with base and reference unmoved, or of several such sessions; one row a reading.

    Parameters
    ----------
    angles : (n, n_joints) array
        Joint angles as read [rad], or displacements of sliding joints [mm]. They may pass a full turn.
    points : (n, 3) array, optional
        Reference points: the tip as measured by a reference instrument, in its frame [mm]. A row of NaN: this reading
        has no reference point. None if no reading has one.
    point_std : (n, 3) array, optional
        Standard uncertainties of `points` along its axes [mm]; NaN where there is no point.
    seat : (n,) array of str, optional
        Name of the seat in which the tip was held; the same name is the same, unknown point. Empty: no seat.
    position : (n,) array of str, optional
        Name of the position that the reading aimed at. Readings of one position are neighbours: a fair split into
        training and test keeps them together.
    tip : (n,) array of str, optional
        Name of the tip, where the flange carries several; of every reading.
    session : (n,) array of str, optional
        Name of the session (base and reference unmoved) in which the arm was read.
    serial_number : (n,) array of str, optional
        Serial number of the arm that was read; of all readings the same, or empty.
    temperature_degC : (n,) array, optional
        Temperature of the arm [degC].
    quaternion : (n, 4) array, optional
        Orientation of the flange in the reference's frame, a unit quaternion w, x, y, z. A row of NaN: not measured.
    sphere, plane, line : (n,) array of str, optional
        Name of the surface (or line) that the tip touched; the same name is the same, unknown one. Empty: none.
    sphere_distance : (n, 2) array, optional
        Distance of the tip's centre from the centre of the sphere that it touches, if known, and its standard
        uncertainty [mm]: half the sum of both diameters for a ball on a stylus. A row of NaN: not known. The same in
        all readings of a sphere.
    anchor : (n,) array of str, optional
        Name of the fixed point, at an unknown place, from which the distance of the tip was measured. Empty: none.
    distance_mm, u_distance_mm : (n,) array, optional
        That distance and its standard uncertainty [mm]. NaN: not measured.
    u_offset_mm : (n,) array, optional
        Standard uncertainty of the error that all distances to one anchor share [mm]: the zero of a wire, the
        certificate of a bar. The same in all readings of an anchor; 1 mm where it is not stated.
    directions : (n, n_joints) array, optional
        Sign of each joint's last movement before the reading: -1, 1, or 0 if it is not known.
    u_scale_ppm : (n,) array, optional
        Standard uncertainty of the scale of the reference, the same error at all its points [1e-6]; one in a session.
    u_common_mm : (n,) array, optional
        Standard uncertainty of a coordinate's error that all points of one position share [mm]; one in a session.
    columns : mapping of str to (n,) array, optional
        Further columns of numbers by their name: ``payload_kg``, the mass that the flange carries [kg], or one that
        starts with ``load_``, torque or load of a joint.
    file : Path, optional
        File of the readings, named in messages.
    angle_columns : tuple of str, optional
        Names of the angle columns in `file`. In a session file they end in the column's unit.
    numbers : (n,) int array, optional
        Number of each reading where it came from, counted from 1: its line in `file` if `by_line`. 1 .. n by default.
    by_line : bool
        Whether `numbers` are lines of `file`.
    unfilled : tuple of str
        Seat, or nothing, of each row of `file` without a number: of a plan that is still to be measured. They are no
        readings.
    n_repeats : (n,) int array, optional
        Of how many readings each is the mean (`truearm.readings.repeats`); 1 each where it is None. Not in a file.
    repeat_std_mm : float
        Standard deviation by which a coordinate of one of them scatters about that mean, beyond its stated uncertainty
        [mm].
    stride : float
        Of a sample: readings of the session from one of these to the next, in the mean. Not in a file.
    pose_errors : PoseErrors, optional
        How points and quaternions err together, and what all readings share; they then are poses, each one measurement.
        Not in a file.

    Raises
    ------
    InputError
        If lengths do not fit each other, a number is not finite or absurdly large, a temperature is not one of an arm,
        uncertainties of the reference are negative or differ in a session,
        a point or a quaternion is given in part, a quaternion is not of length 1, a direction is not -1, 0 or 1,
        distances from a sphere are not positive or differ, or one to an anchor is not positive or lacks its anchor.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.Session([[0.1, 0.2], [0.3, -0.4]], points=[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    >>> len(session), session.n_joints
    (2, 2)
    >>> session.called(1)
    'reading 2'
    """

    def split(self, *, by: SplitBy = "position", hold_out: float = 0.3, seed: int = 0) -> tuple[Session, Session]:
        """Split into training and test readings, whole groups at a time.

        Readings of one position, seat or session are neighbours. Kept together, they ask a model about places that it
        has not seen.

        Parameters
        ----------
        by : {"position", "seat", "session", "row"}
            What names the groups; ``row``: every reading is a group, but those of one pose are together.
        hold_out : float
            Share of the groups that become test readings, between 0 and 1; each part gets at least one group.
        seed : int
            The same seed gives the same split.

        Returns
        -------
        train, test : Session

        Raises
        ------
        InputError
            If the readings do not name their groups, a name is empty, or there are fewer than two groups.

        Examples
        --------
        >>> import truearm as ta
        >>> session = ta.Session([[0.1], [0.2], [0.3], [0.4]], position=["A", "A", "B", "B"])
        >>> train, test = session.split(by="position", hold_out=0.5, seed=1)
        >>> train.position.tolist(), test.position.tolist()
        (['B', 'B'], ['A', 'A'])
        """
        groups = _groups(self, by)
        held = chosen_groups(int(groups.max()) + 1, fraction=hold_out, seed=seed, by=by, file=self.file)[groups]
        return self.rows(~held), self.rows(held)

    @classmethod
    def from_frame(cls, frame: pd.DataFrame) -> Self:
        """Build a session from a data frame with the columns of the session file (docs/session-file.md).

        Parameters
        ----------
        frame : pandas.DataFrame
            Columns ``q1_deg``, ``q2_deg``, .. (or ``_rad``; ``_mm`` for sliding joints), and any of ``x_mm, y_mm,
            z_mm``, ``seat``, ``position``, ``session``, ``temperature_degC`` and so on. The names state the units; no
            unit is guessed. Missing values are NaN or None. The index is not used.

        Raises
        ------
        InputError
            If a column is unknown, lacks its unit or is missing, or a value breaks a rule; with column and reading.

        Examples
        --------
        >>> import pandas as pd
        >>> import truearm as ta
        >>> frame = pd.DataFrame({"q1_deg": [0.0, 90.0], "x_mm": [500.0, 0.0], "y_mm": [0.0, 500.0], "z_mm": 0.0})
        >>> ta.Session.from_frame(frame).points.tolist()
        [[500.0, 0.0, 0.0], [0.0, 500.0, 0.0]]
        """
        return cls(**fields_of_frame(frame))

    def to_frame(self) -> pd.DataFrame:
        """Return a data frame with the columns of the session file; ``Session.from_frame`` reads it back.

        Angles are in degrees (sliding joints in mm), or in the units of the file that the readings came from.

        Examples
        --------
        >>> import truearm as ta
        >>> list(ta.Session([[0.1, 0.2]], seat=["A"]).to_frame().columns)
        ['q1_deg', 'q2_deg', 'seat']
        """
        return data_frame(session_columns(self))

    def save(self, path: str | Path) -> None:
        """Write the session file, ``.csv`` or ``.parquet``; `read_session` reads it back.

        Raises
        ------
        InputError
            If the suffix is neither, or the folder does not exist.

        Examples
        --------
        >>> import tempfile
        >>> from pathlib import Path
        >>> import truearm as ta
        >>> file = Path(tempfile.mkdtemp()) / "session.csv"
        >>> ta.Session([[0.1, 0.2]]).save(file)
        >>> len(ta.read_session(file))
        1
        """
        write_session(self, path)

    def _repr_html_(self) -> str:
        """The number of readings and the first of them, as notebooks show them."""
        head = self.rows(np.arange(min(len(self), 5))).to_frame()
        return f"<p>{len(self)} readings of {self.n_joints} joints</p>{head.to_html(index=False)}"


def read_session(path: str | Path, *, n_joints: int | None = None) -> Session:
    r"""Read a session file (docs/session-file.md).

    Parameters
    ----------
    path : path
        CSV (comma, decimal point, UTF-8, or as a spreadsheet of another country saves it), or Parquet with the same
        columns (needs ``truearm[parquet]``).
    n_joints : int, optional
        The arm's number of joints; any number by default.

    Returns
    -------
    Session
        Angles in rad (sliding joints in mm), points in mm. Rows without any number are those of a plan that is half
        filled in: they are no readings; `Session.unfilled` has the seats they name.

    Raises
    ------
    InputError
        If the file breaks a rule of the format; with file, line, column and what to do.

    Examples
    --------
    >>> from pathlib import Path
    >>> import truearm as ta
    >>> _ = Path("session.csv").write_text("q1_deg,q2_deg,x_mm,y_mm,z_mm\n10,20,500,0,100\n30,-40,400,200,100\n")
    >>> ta.read_session("session.csv")
    Session(2 readings of 2 joints, session.csv)
    """
    return Session(**read_fields(path, n_joints=n_joints))


def chosen_groups(n_groups: int, *, fraction: float, seed: int, by: str, file: Path | None) -> BoolArray:
    """(n_groups,) which groups are held out; see `Session.split`.

    Raises
    ------
    InputError
        If the share is not between 0 and 1, or there are fewer than two groups.
    """
    if not 0 < fraction < 1:
        raise InputError(f"the share to hold out must lie between 0 and 1, got {fraction}", hint="0.3")
    if n_groups < 2:
        raise InputError(f"a split needs readings of at least two {by}s, got one", file=file)
    n_test = min(max(round(fraction * n_groups), 1), n_groups - 1)
    chosen = np.zeros(n_groups, bool)
    chosen[np.random.default_rng(seed).permutation(n_groups)[:n_test]] = True
    return chosen


def stratified_rows(readings: Readings, n: int, *, seed: int) -> IntArray:
    """Choose a few readings, spread over the positions that they aimed at.

    With reference points: one reading of each position in turn, the positions in random order; readings at random if
    positions are not named. Without: readings in a few seats, five or more in each, as a single one has no information.
    Without seats: distances, as many to each anchor.

    Parameters
    ----------
    readings : Readings
    n : int
        Number of readings; as distances and tips of one pose stay together, there may be some more.
    seed : int
        The same seed gives the same rows.

    Returns
    -------
    (n,) int array, or more
        Rows, rising.

    Raises
    ------
    InputError
        If there are fewer readings with a reference point, or in seats.
    """
    rng = np.random.default_rng(seed)
    rows = np.flatnonzero(readings.has_point)
    group = rows if readings.position is None else np.unique(readings.position[rows], return_inverse=True)[1]
    if not len(rows) and readings.seat is not None:
        rows = np.flatnonzero(readings.seat != "")
        seats, group = np.unique(readings.seat[rows], return_inverse=True)
        shuffled = rng.permutation(len(seats))
        needed = int(np.searchsorted(np.cumsum(np.bincount(group)[shuffled]), n)) + 1
        few = np.isin(group, shuffled[: max(n // READINGS_A_SEAT, needed)])
        rows, group = (rows[few], group[few]) if n <= len(rows) else (rows, group)
    if not len(rows):
        rows = np.flatnonzero(rows_with_distance(readings))
        # Wires in turn.
        group = rows if readings.anchor is None else np.unique(readings.anchor[rows], return_inverse=True)[1]
    if not 1 <= n <= len(rows):
        what = "reference points" if readings.points is not None else "a seat or a distance"
        raise readings.error(f"expected a number of rows from 1 to the {len(rows)} readings with {what}, got {n}")
    order = rng.permutation(len(rows))
    turn = np.empty(len(rows))  # within its group
    for g in np.unique(group):
        turn[group == g] = rng.permutation(int((group == g).sum()))
    rows = rows[np.lexsort((order, turn))]
    _, first, pose, count = np.unique(
        readings_of_one_pose(readings, exactly=True)[rows], return_index=True, return_inverse=True, return_counts=True
    )
    by_turn = np.argsort(first)
    n_poses = int(np.searchsorted(np.cumsum(count[by_turn]), n)) + 1
    return np.sort(rows[np.isin(pose, by_turn[:n_poses])])


def _groups(readings: Readings, by: SplitBy) -> IntArray:
    """Give each reading the number of its group."""
    if by == "row":
        return np.unique(readings_of_one_pose(readings), return_inverse=True)[1]
    return np.unique(group_names(readings, by), return_inverse=True)[1]


def group_names(readings: Readings, by: str) -> NameArray:
    """(n,) names of the groups of readings.

    Raises
    ------
    InputError
        If the readings do not name their groups, or a name is empty.
    """
    kinds = get_args(SplitBy)
    if by not in kinds[:-1]:
        raise InputError(f"expected a split by {', '.join(kinds)}, got {by!r}")
    names: NameArray | None = getattr(readings, by)
    if names is None:
        present = [name for name in kinds[:-1] if getattr(readings, name) is not None]
        raise readings.error(
            f"the readings have no column {by!r} to split by",
            hint=f"by {' or '.join([*present, 'row'])}, or name a {by} for every reading",
        )
    if (names == "").any():
        row = int(np.argmax(names == ""))
        raise readings.error(f"the reading names no {by}, so it belongs to no group", row, column=by)
    return names
