"""A session: readings of an arm with base and reference unmoved, in files and data frames, and split.

One thing may not have two spellings in it.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from truearm.findings import Finding
from truearm.readings.columns import data_frame, fields_of_frame, session_columns
from truearm.readings.files import read_fields, write_session
from truearm.readings.lengths import Lengths
from truearm.readings.readings import NAMED, Readings, folded_name
from truearm.readings.split import SplitBy
from truearm.readings.split import hold_out as split

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


if TYPE_CHECKING:
    import pandas as pd


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
            What names the groups; ``row``: every reading is a group.
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
        return split(self, by=by, fraction=hold_out, seed=seed)

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
