"""A session: readings of an arm, that is joint angles and what is known of the tip at each."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.readings.distances import ANCHOR_DISTANCE, check_anchor_distances, check_sphere_distances
from truearm.readings.reference_uncertainty import SHARED_UNCERTAINTIES, check_shared_uncertainties
from truearm.typing import BoolArray, FloatArray, IntArray, NameArray

if TYPE_CHECKING:
    import pandas as pd

    from truearm.readings.split import SplitBy

# Columns with one name a reading, in the order of the session file; the first of them name what the tip touched, or
# the fixed point from which its distance was measured.
TOUCHED = ("seat", "sphere", "plane", "line", "anchor")
NAMED = (*TOUCHED, "tip", "position", "session", "serial_number")

# Mass that the flange carries [kg].
PAYLOAD = "payload_kg"
# No arm carries more [kg]; a mass in grams does exceed it.
LARGEST_PAYLOAD_KG = 1e4
# Names of further columns of numbers, such as the torque of a joint (load_1_Nm).
LOAD = re.compile(rf"load_[\w.-]+|{PAYLOAD}")

# Columns with the sign of each joint's last movement: this and the joint's number.
DIRECTION = "direction_"

# A quaternion's length may differ from 1 by this much, the effect of rounding to two decimals; it is normalized.
QUATERNION_TOLERANCE = 0.01

# Temperatures of an arm in use [degC]; others are of another scale, or lost their decimal point.
COLDEST_DEGC, WARMEST_DEGC = -50.0, 100.0
ABSOLUTE_ZERO_DEGC = -273.15

# No coordinate or uncertainty is larger [mm], whatever the frame: a thousand kilometres. Beyond, squares overflow.
LARGEST_MM = 1e9
# A load may have any unit, but its square must be a number.
LARGEST_LOAD = 1e100

# What may be stated beside the angles, in fields of their own.
_BESIDE_ANGLES = (
    *("points", "point_std", "temperature_degC", "quaternion", "sphere_distance", "directions"),
    *(*SHARED_UNCERTAINTIES, *ANCHOR_DISTANCE, *NAMED),
)


@dataclass(frozen=True, eq=False)
class Session:
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

    angles: FloatArray
    points: FloatArray | None = None
    point_std: FloatArray | None = None
    seat: NameArray | None = None
    position: NameArray | None = None
    session: NameArray | None = None
    serial_number: NameArray | None = None
    temperature_degC: FloatArray | None = None
    quaternion: FloatArray | None = None
    sphere: NameArray | None = None
    plane: NameArray | None = None
    line: NameArray | None = None
    sphere_distance: FloatArray | None = None
    anchor: NameArray | None = None
    distance_mm: FloatArray | None = None
    u_distance_mm: FloatArray | None = None
    u_offset_mm: FloatArray | None = None
    tip: NameArray | None = None
    directions: FloatArray | None = None
    u_scale_ppm: FloatArray | None = None
    u_common_mm: FloatArray | None = None
    columns: Mapping[str, FloatArray] = field(default_factory=dict)
    file: Path | None = None
    angle_columns: tuple[str, ...] | None = None
    numbers: IntArray | None = None
    by_line: bool = False
    unfilled: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        angles = np.asarray(self.angles, dtype=float)
        if angles.ndim != 2 or angles.shape[1] < 1:
            raise InputError(f"expected angles of shape (n, n_joints), got {angles.shape}")
        object.__setattr__(self, "angles", angles)
        n = len(angles)
        numbers = np.arange(1, n + 1) if self.numbers is None else np.asarray(self.numbers, dtype=np.intp)
        if numbers.shape != (n,):
            raise InputError(f"expected numbers of shape {(n,)}, got {numbers.shape}")
        object.__setattr__(self, "numbers", numbers)
        stated = vars(self)
        # Angles alone, as in predictions one by one: checks of all that may be beside them take a tenth of the time.
        if not self.columns and all(stated[name] is None for name in _BESIDE_ANGLES) and np.isfinite(angles).all():
            return
        for name, shape in (
            ("points", (n, 3)),
            ("point_std", (n, 3)),
            ("temperature_degC", (n,)),
            ("quaternion", (n, 4)),
            ("sphere_distance", (n, 2)),
            ("directions", angles.shape),
            *((name, (n,)) for name in (*SHARED_UNCERTAINTIES, *ANCHOR_DISTANCE)),
        ):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _shaped(value, shape, name))
        for name in NAMED:
            value = getattr(self, name)
            if value is not None:
                value = np.asarray(value, dtype=np.str_)
                if value.shape != (n,):
                    raise InputError(f"expected {name} of shape {(n,)}, got {value.shape}")
                object.__setattr__(self, name, value)
        if bad := [name for name in self.columns if not LOAD.fullmatch(name)]:
            raise InputError(f"expected names of further columns such as load_1_Nm, got {bad[0]!r}")
        object.__setattr__(self, "columns", {k: _shaped(v, (n,), k) for k, v in self.columns.items()})
        self._check_numbers()
        self._check_std()
        self._check_directions()
        check_shared_uncertainties(self)
        check_sphere_distances(self)
        check_anchor_distances(self)
        self._check_tips()
        self._settle_quaternion()
        if n and not self.has_point.any():
            object.__setattr__(self, "points", None)
            object.__setattr__(self, "point_std", None)

    def _check_numbers(self) -> None:
        """Finite everywhere; points, their uncertainties and quaternions may be missing, but only whole."""
        plain = {"angles": self.angles, "temperature_degC": self.temperature_degC, **self.columns}
        for name, value in plain.items():
            if value is not None and not np.isfinite(value).all():
                row = int(np.argwhere(~np.isfinite(value))[0, 0])
                raise self.error(f"expected finite numbers in {name}, got {value[row]}", row)
        whole = {
            "points": "x, y and z",
            "point_std": "sx, sy and sz",
            "quaternion": "w, x, y and z",
            "sphere_distance": "distance and uncertainty",
        }
        for name, parts in whole.items():
            value = getattr(self, name)
            if value is None or np.isfinite(value).all():
                continue
            bad = np.isinf(value).any(axis=1) | (np.isnan(value).any(axis=1) & ~np.isnan(value).all(axis=1))
            if bad.any():
                row = int(np.argmax(bad))
                what = "expected finite numbers" if np.isinf(value[row]).any() else f"expected {parts} or none of them"
                raise self.error(
                    f"{what} in {name}, got {value[row].tolist()}",
                    row,
                    hint="fill in what is missing, or leave all of them out",
                )
        self._check_sizes()
        self._check_payload()
        self._check_temperature()

    def _check_sizes(self) -> None:
        """Refuse numbers so large that they are no lengths, and that later arithmetic would overflow."""
        sizes = dict.fromkeys(("points", "point_std", "sphere_distance", *ANCHOR_DISTANCE), (LARGEST_MM, " mm"))
        for name, (largest, unit) in (sizes | dict.fromkeys(self.columns, (LARGEST_LOAD, ""))).items():
            value = self.columns.get(name, getattr(self, name, None))
            if value is not None and (far := np.abs(value) > largest).any():
                row = int(np.argwhere(far)[0, 0])
                got = np.atleast_1d(value[row])[np.atleast_1d(far[row])][0]
                raise self.error(
                    f"expected numbers up to {largest:g}{unit} in {name}, got {got:g}{unit}",
                    row,
                    hint="check the unit and the decimal sign",
                )

    def _check_payload(self) -> None:
        kg = self.columns.get(PAYLOAD)
        if kg is not None and (odd := (kg < 0) | (kg > LARGEST_PAYLOAD_KG)).any():
            row = int(np.argmax(odd))
            raise self.error(
                f"expected a payload of 0 to {LARGEST_PAYLOAD_KG:g} kg, got {kg[row]:g} kg",
                row,
                column=None if self.file is None else PAYLOAD,
                hint="state the mass on the flange in kg; 0 without a payload",
            )

    def _check_temperature(self) -> None:
        if self.temperature_degC is None:
            return
        odd = (self.temperature_degC < COLDEST_DEGC) | (self.temperature_degC > WARMEST_DEGC)
        if not odd.any():
            return
        row = int(np.argmax(odd))
        degC = float(self.temperature_degC[row])
        if degC < ABSOLUTE_ZERO_DEGC:
            problem, hint = f"{degC:g} degC is below absolute zero", "check the temperature, or delete its column"
        else:
            problem = f"expected a temperature of {COLDEST_DEGC:g} to {WARMEST_DEGC:g} degC, got {degC:g} degC"
            hint = "state it in degC: kelvin less 273.15, or (degrees Fahrenheit - 32) / 1.8"
        raise self.error(problem, row, column=None if self.file is None else "temperature_degC", hint=hint)

    def _check_std(self) -> None:
        if self.point_std is None:
            return
        if self.points is None:
            raise self.error("point_std needs points: without a reference point it has no meaning")
        odd = np.isnan(self.point_std[:, 0]) == self.has_point
        if odd.any():
            row = int(np.argmax(odd))
            what = "a point without one" if self.has_point[row] else "one without a point"
            raise self.error(
                f"expected a standard uncertainty where there is a point and only there, got {what}",
                row,
                hint="leave the uncertainties out of the file if they are not all known",
            )
        if (self.point_std <= 0).any():
            row = int(np.argwhere(self.point_std <= 0)[0, 0])
            raise self.error(
                f"standard uncertainties must be positive, got {self.point_std[row].tolist()} mm",
                row,
                hint="leave the uncertainties out of the file if they are not known",
            )

    def _check_directions(self) -> None:
        if self.directions is None:
            return
        odd = ~np.isin(self.directions, (-1.0, 0.0, 1.0))
        if odd.any():
            row, joint = np.argwhere(odd)[0].tolist()
            raise self.error(
                f"expected a direction of movement as -1, 0 or 1, got {self.directions[row, joint]:g} for J{joint + 1}",
                row,
                column=None if self.file is None else f"{DIRECTION}{joint + 1}",
                hint="give the sign of the joint's last movement before the reading; 0 if it is not known",
            )

    def _check_tips(self) -> None:
        """A tip of every reading, or of none."""
        if self.tip is None or (self.tip != "").all():
            return
        if (self.tip != "").any():
            raise self.error(
                "expected the tip of every reading, got none",
                int(np.argmin(self.tip != "")),
                column=None if self.file is None else "tip",
                hint="name the tip of all readings, or remove the column if there is one tip",
            )
        object.__setattr__(self, "tip", None)

    def _settle_quaternion(self) -> None:
        """Make quaternions exactly of length 1, or None where no reading has one."""
        if self.quaternion is None or not len(self):
            return
        length = np.linalg.norm(self.quaternion, axis=1)
        if np.isnan(length).all():
            object.__setattr__(self, "quaternion", None)
            return
        off = np.abs(length - 1)
        if np.nanmax(off) > QUATERNION_TOLERANCE:
            row = int(np.nanargmax(off > QUATERNION_TOLERANCE))
            raise self.error(
                f"expected a quaternion of length 1, got length {length[row]:.6g}",
                row,
                hint="give an orientation as w, x, y, z; the scalar part w comes first",
            )
        # A normalized one stays as it is, to the last bit.
        rounded = (off > 1e-12)[:, None]
        settled = np.where(rounded, self.quaternion / length[:, None], self.quaternion)
        object.__setattr__(self, "quaternion", settled)

    def __repr__(self) -> str:
        return f"Session({len(self)} readings of {self.n_joints} joints{f', {self.file.name}' if self.file else ''})"

    def __len__(self) -> int:
        return len(self.angles)

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return int(self.angles.shape[1])

    @property
    def has_point(self) -> BoolArray:
        """(n,) Whether each reading has a reference point."""
        return np.zeros(len(self), bool) if self.points is None else ~np.isnan(self.points[:, 0])

    def called(self, row: int) -> str:
        """Name row `row` (counted from 0) for a person: ``line 14``, without a file ``reading 12``."""
        return f"{'line' if self.by_line else 'reading'} {cast(IntArray, self.numbers)[row]}"

    def error(
        self, problem: str, row: int | None = None, *, column: str | None = None, hint: str | None = None
    ) -> InputError:
        """Make an error that states the file, and the line of `row` (counted from 0) or its number."""
        name = None if row is None or self.by_line else self.called(row)
        line = None if row is None else self.line_of(row)
        return InputError(problem, file=self.file, line=line, column=column, hint=hint, row=name)

    def line_of(self, row: int) -> int | None:
        """Return the line of row `row` (counted from 0) in `file`; None if rows are not lines."""
        return int(cast(IntArray, self.numbers)[row]) if self.by_line else None

    def rows(self, which: npt.ArrayLike) -> Session:
        """Select readings by `which` (indices, slice or mask); each keeps its number or line."""
        index: Any = which if isinstance(which, slice) else np.asarray(which)
        chosen: dict[str, Any] = {
            f.name: getattr(self, f.name)[index] for f in fields(self) if isinstance(getattr(self, f.name), np.ndarray)
        }
        columns = {name: values[index] for name, values in self.columns.items()}
        return replace(self, **chosen, columns=columns)

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
        from truearm.readings.split import hold_out as split

        return split(self, by=by, fraction=hold_out, seed=seed)

    @classmethod
    def from_frame(cls, frame: pd.DataFrame) -> Session:
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
        from truearm.readings.columns import session_from_frame

        return session_from_frame(frame)

    def to_frame(self) -> pd.DataFrame:
        """Return a data frame with the columns of the session file; ``Session.from_frame`` reads it back.

        Angles are in degrees (sliding joints in mm), or in the units of the file that the readings came from.

        Examples
        --------
        >>> import truearm as ta
        >>> list(ta.Session([[0.1, 0.2]], seat=["A"]).to_frame().columns)
        ['q1_deg', 'q2_deg', 'seat']
        """
        import pandas as pd

        from truearm.readings.columns import session_columns

        columns = session_columns(self)
        return pd.DataFrame({n: v.tolist() if v.dtype.kind == "U" else v for n, v in columns.items()})

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
        from truearm.readings.files import write_session

        write_session(self, path)

    def _repr_html_(self) -> str:
        """The number of readings and the first of them, as notebooks show them."""
        head = self.rows(np.arange(min(len(self), 5))).to_frame()
        return f"<p>{len(self)} readings of {self.n_joints} joints</p>{head.to_html(index=False)}"


def _shaped(value: npt.ArrayLike, shape: tuple[int, ...], name: str) -> FloatArray:
    array = np.asarray(value, dtype=float)
    if array.shape != shape:
        raise InputError(f"expected {name} of shape {shape}, got {array.shape}")
    return array
