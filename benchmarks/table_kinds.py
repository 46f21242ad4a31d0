"""Tables as programs and people write them: the same readings of an arm of six joints in many kinds of files.

A kind is a function with ``@kind(...)`` that returns the bytes of a file. Beside it stand the columns that hold the
readings, what an ordinary person states, and what is right.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import import_module

import numpy as np

from truearm.typing import FloatArray

Table = list[list[str]]
N = 12
_random = np.random.default_rng(27)
ANGLES = np.round(_random.uniform(-170, 170, (N, 6)), 4)
POINTS = np.round(_random.uniform(-2400, 2400, (N, 3)), 4)
ANGLES[2, 0], ANGLES[5, 3], POINTS[1] = 0.5, -0.25, (1500.0, -2000.0, 1250.5)
LOST = POINTS.copy()
LOST[[2, 7]] = np.nan
WHOLE = np.round(POINTS)
AXES = ("X", "Y", "Z")
JOINTS = tuple(f"J{i}" for i in range(1, 7))
KINDS: dict[str, Kind] = {}
MODULES = ("table_programs", "table_formats")  # beside this one, where more are registered


@dataclass(frozen=True)
class Kind:
    """A kind of table.

    Attributes
    ----------
    name, suffix : str
        What it is, and how its file ends.
    write : callable
        Returns the bytes of the file.
    angles, points : sequence of str
        Columns, by names or numbers.
    angle_unit, point_unit : str
        Of the table.
    right_angles, right_points : array
        What shall be read [deg], [mm].
    options : dict
        What a person states beside columns and units: options of ``truearm import``.
    remedy : dict
        What the refusal shall advise, and what then makes it right; empty if the kind shall be read at once.
    """

    name: str
    write: Callable[[], bytes]
    suffix: str = ".csv"
    angles: Sequence[str] = JOINTS
    points: Sequence[str] = AXES
    angle_unit: str = "deg"
    point_unit: str = "mm"
    right_angles: FloatArray = field(default_factory=lambda: ANGLES)
    right_points: FloatArray = field(default_factory=lambda: POINTS)
    options: dict[str, str] = field(default_factory=dict)
    remedy: dict[str, str] = field(default_factory=dict)

    def is_right(self, found: tuple[FloatArray, FloatArray | None]) -> bool:
        """Whether angles [deg] and points [mm] are those of the table; a lost target has no point."""
        angles, points = found
        if angles.shape != self.right_angles.shape or not close(angles, self.right_angles):
            return False
        return not self.points or (points is not None and close(points, self.right_points))


def all_kinds() -> dict[str, Kind]:
    """Every kind, by name."""
    for module in MODULES:
        import_module(f"benchmarks.{module}")
    return KINDS


def close(one: FloatArray, other: FloatArray) -> bool:
    """Whether numbers agree to a millionth of a degree or millimetre."""
    return one.shape == other.shape and np.allclose(one, other, rtol=0, atol=1e-6, equal_nan=True)


def kind(name: str, **facts: object) -> Callable[[Callable[[], str | bytes]], Callable[[], str | bytes]]:
    """Register a function that writes a kind of table; text is written in UTF-8."""

    def register(write: Callable[[], str | bytes]) -> Callable[[], str | bytes]:
        def content() -> bytes:
            written = write()
            return written if isinstance(written, bytes) else written.encode()

        if name in KINDS:
            raise ValueError(name)
        KINDS[name] = Kind(name, content, **facts)  # type: ignore[arg-type]
        return write

    return register


# Parts of tables ------------------------------------------------------------------------------------------------------


def rows(angles: FloatArray = ANGLES, points: FloatArray = POINTS, form: str = ".4f", none: str = "") -> Table:
    """Cells of the readings."""
    values = np.hstack([angles, points])
    return [[none if np.isnan(v) else f"{v:{form}}" for v in row] for row in values.tolist()]


def grouped(cells: Table, sign: str, decimal: str = ".") -> Table:
    """Numbers with a sign between thousands."""

    def one(cell: str) -> str:
        number, _, fraction = cell.partition(".")
        number = re.sub(r"(?<=\d)(?=(\d{3})+$)", sign, number)
        return number + (decimal + fraction if fraction else "")

    return [[one(cell) for cell in row] for row in cells]


def comma(cells: Table) -> Table:
    """Numbers with a decimal comma."""
    return [[cell.replace(".", ",") for cell in row] for row in cells]


def text(cells: Table, *head: Sequence[str] | str, sep: str = ",", end: str = "\n", foot: str = "") -> str:
    """A text of lines; of the lines above the rows those that are no strings are joined too."""
    lines = [line if isinstance(line, str) else sep.join(line) for line in (*head, *cells)]
    return end.join(lines) + end + foot


HEAD = (*JOINTS, *AXES)


def counted(cells: Table, start: int = 1) -> Table:
    """Rows with their number in front."""
    return [[str(i), *row] for i, row in enumerate(cells, start)]


def fixed(cells: Table, *head: Sequence[str], width: int = 12) -> str:
    """Columns of fixed width, to the right."""
    return "".join("".join(f"{cell:>{width}}" for cell in row) + "\n" for row in (*head, *cells))


def changed(cells: Table, columns: slice, change: Callable[[str], str]) -> Table:
    """Cells with some columns changed."""
    return [[*row[: columns.start], *map(change, row[columns]), *row[columns.stop :]] for row in cells]


ANGLE_CELLS, POINT_CELLS = slice(0, 6), slice(6, 9)
RAD = np.round(np.radians(ANGLES), 10)
METRES = np.round(POINTS / 1000, 7)
NUMBERS = {"angles": tuple("123456"), "points": tuple("789")}


def numbers_from(first: int) -> dict[str, tuple[str, ...]]:
    """Columns by number, the first joint in column `first`."""
    return {"angles": tuple(str(first + i) for i in range(6)), "points": tuple(str(first + i) for i in range(6, 9))}


# Separators and lines -------------------------------------------------------------------------------------------------

kind("commas")(lambda: text(rows(), HEAD))
kind("semicolons")(lambda: text(rows(), HEAD, sep=";"))
kind("semicolons, decimal commas")(lambda: text(comma(rows()), HEAD, sep=";"))
kind("tabs", suffix=".tsv")(lambda: text(rows(), HEAD, sep="\t"))
kind("tabs, decimal commas", suffix=".txt")(lambda: text(comma(rows()), HEAD, sep="\t"))
kind("one blank", suffix=".txt")(lambda: text(rows(), HEAD, sep=" "))
kind("blanks in runs", suffix=".txt")(lambda: fixed(rows(), HEAD))
kind("blanks, decimal commas", suffix=".txt")(lambda: fixed(comma(rows()), HEAD))
kind("pipes", suffix=".txt")(lambda: text(rows(), HEAD, sep=" | "))
kind("Markdown", suffix=".md")(lambda: "".join(f"| {' | '.join(row)} |\n" for row in (HEAD, ["---"] * 9, *rows())))
kind("a ruler below the names", suffix=".txt")(lambda: fixed([], HEAD) + "-" * 108 + "\n" + fixed(rows()))
kind("commas and blanks")(lambda: text(rows(), HEAD, sep=", "))
kind("no header", **NUMBERS)(lambda: text(rows()))
kind("no header, blanks", suffix=".txt", **NUMBERS)(lambda: fixed(rows()))
kind("sep= line")(lambda: "sep=;\n" + text(rows(), HEAD, sep=";"))
kind("separators at the ends of rows")(lambda: text([[*row, ""] for row in rows()], [*HEAD, ""], sep=";"))
kind("empty columns of a spreadsheet")(lambda: text([[*row, "", "", ""] for row in rows()], [*HEAD, "", "", ""]))
kind("rows shorter than the header", right_points=LOST)(
    lambda: re.sub(r",+$", "", text(rows(points=LOST), HEAD), flags=re.MULTILINE)
)
kind("line ends of the old Macintosh")(lambda: text(rows(), HEAD, end="\r"))
kind("doubled carriage returns")(lambda: text(rows(), HEAD, end="\r\r\n"))
kind("no line end at the end")(lambda: text(rows(), HEAD).rstrip())
kind("last line cut off", right_angles=ANGLES[:-1], right_points=POINTS[:-1])(lambda: text(rows(), HEAD)[:-40])
kind("all cells quoted")(lambda: text([[f'"{c}"' for c in row] for row in rows()], [f'"{c}"' for c in HEAD]))
kind("decimal commas quoted between commas")(
    lambda: text([[f'"{c}"' for c in row] for row in comma(rows())], [f'"{c}"' for c in HEAD])
)
kind("decimal commas not quoted between commas")(lambda: text(comma(rows()), HEAD))
kind("a line break in a name", angles=["J1 [deg]", *JOINTS[1:]])(lambda: text(rows(), ['"J1\n[deg]"', *HEAD[1:]]))


# Encodings ------------------------------------------------------------------------------------------------------------

GERMAN = [f"Achse {i} (°)" for i in range(1, 7)] + ["Länge X", "Länge Y", "Länge Z"]
CHINESE = [f"关节{i}角度" for i in range(1, 7)] + ["坐标X", "坐标Y", "坐标Z"]
NAMED_GERMAN = {"angles": tuple(GERMAN[:6]), "points": tuple(GERMAN[6:])}
NAMED_CHINESE = {"angles": tuple(CHINESE[:6]), "points": tuple(CHINESE[6:])}
kind("UTF-8 with a byte order mark")(lambda: text(rows(), HEAD).encode("utf-8-sig"))
kind("UTF-16 with a byte order mark")(lambda: text(rows(), HEAD, sep="\t").encode("utf-16"))
kind("UTF-16 without a mark")(lambda: text(rows(), HEAD).encode("utf-16-le"))
kind("cp1252", **NAMED_GERMAN)(lambda: text(comma(rows()), GERMAN, sep=";").encode("cp1252"))
kind("GB18030", **NAMED_CHINESE)(lambda: text(rows(), CHINESE).encode("gb18030"))
kind("names in UTF-8", **NAMED_CHINESE)(lambda: text(rows(), CHINESE))

# Lines around the rows ------------------------------------------------------------------------------------------------

UNITS = ["deg"] * 6 + ["mm"] * 3
kind("units row in brackets")(lambda: text(rows(), HEAD, [f"[{unit}]" for unit in UNITS]))
kind("units row without brackets")(lambda: text(rows(), HEAD, UNITS, sep=";"))
kind("units in names", angles=[f"{j} [deg]" for j in JOINTS], points=[f"{a} (mm)" for a in AXES])(
    lambda: text(rows(), [f"{j} [deg]" for j in JOINTS] + [f"{a} (mm)" for a in AXES])
)
kind("units behind names", angles=[f"q{i}_deg" for i in range(1, 7)], points=[f"{a}_mm" for a in "xyz"])(
    lambda: text(rows(), [f"q{i}_deg" for i in range(1, 7)] + [f"{a}_mm" for a in "xyz"])
)
kind("lines with #")(lambda: text(rows(), "# cell 3, arm 7", "# operator: A. B.", HEAD))
kind("lines with %", suffix=".txt")(lambda: text(rows(), "% exported 2024-05-02", HEAD, sep="\t"))
kind("lines with //")(lambda: text(rows(), "// program TEST", HEAD))
kind("lines with ;")(lambda: text(rows(), "; program TEST", HEAD))
kind("a remark between rows")(lambda: text(rows()[:6], HEAD) + "# tool changed\n" + text(rows()[6:]))
kind("names behind #", suffix=".txt")(lambda: text(rows(), "# " + " ".join(HEAD), sep=" "))
kind("a title")(lambda: text(rows(), "Calibration of arm 7, May", "", HEAD))
kind("key and value above", suffix=".txt")(
    lambda: text(rows(), "Serial number: 4711", "Date: 02.05.2024 10:31", "Temperature: 20,5", "", HEAD, sep="\t")
)
kind("remark behind a row", suffix=".txt")(
    lambda: text(rows()[:4], HEAD, sep=" ") + " ".join(rows()[4]) + "  # again\n" + text(rows()[5:], sep=" ")
)
kind("number of rows at the foot")(lambda: text(counted(rows()), ["No", *HEAD], sep=";", foot="n = 12\n"))
kind("mean at the foot")(lambda: text(counted(rows()), ["No", *HEAD], foot="Mean," + ",".join(["1.5"] * 9) + "\n"))
kind("statistics at the foot")(
    lambda: text(
        counted(rows()),
        ["No", *HEAD],
        sep=";",
        foot="\n" + "".join(f"{w};" + ";".join(["1.5"] * 9) + "\n" for w in ("Mittelwert", "Std. Dev.", "Max")),
    )
)
kind("end of file at the foot")(lambda: text(rows(), HEAD, foot="\nEnd of file\n"))
kind("an empty line between blocks")(lambda: text(rows()[:6], HEAD) + "\n" + text(rows()[6:]))
kind("the header again between blocks")(lambda: text(rows()[:6], HEAD) + "\n" + text(rows()[6:], HEAD))
kind("another table below")(
    lambda: text(rows(), HEAD) + "\n" + text([["B1", "1.5", "2.5", "3.5"]], ["Name", "a", "b", "c"])
)
kind("groups with blanks", angles=JOINTS, points=[f"Tool tip {a}" for a in AXES])(
    lambda: text(
        [[*row[:6], *row[6:], "1.5", "2.5", "3.5"] for row in rows()],
        ["Robot arm", *[""] * 5, "Tool tip", "", "", "Base ball", "", ""],
        [*JOINTS, *AXES, *AXES],
    )
)
kind("groups above numbers", angles=tuple("123456"))(
    lambda: text(rows(), ["Joint"] * 6 + ["Tip"] * 3, [*"123456", *AXES])
)
kind("names with blanks", suffix=".txt", angles=[f"Axis {i}" for i in range(1, 7)], points=[f"Tip {a}" for a in AXES])(
    lambda: fixed(rows(), [f"Axis {i}" for i in range(1, 7)] + [f"Tip {a}" for a in AXES])
)

# Cells ----------------------------------------------------------------------------------------------------------------

for _name, _none in {
    "empty cells of a lost target": "",
    "- for nothing": "-",
    "-- for nothing": "--",
    "n/a for nothing": "n/a",
    "NaN for nothing": "NaN",
    "stars for nothing": "******",
    "#DIV/0! for nothing": "#DIV/0!",
    "#N/A for nothing": "#N/A",
}.items():
    kind(_name, right_points=LOST)(lambda none=_none: text(rows(points=LOST, none=none), HEAD))  # type: ignore[misc]


def lost(sign: float, form: str = ".4f") -> str:
    """A table in which a number stands for the coordinates of a lost target."""
    return text(rows(points=np.where(np.isnan(LOST), sign, LOST), form=form), HEAD)


kind("0, 0, 0 of a lost target", right_points=LOST)(lambda: lost(0.0))
kind("-9999 of a lost target", right_points=LOST)(lambda: lost(-9999.0))
kind("1e30 of a lost target", right_points=LOST)(lambda: lost(1e30, ".8g"))
kind("unicode minus")(lambda: text(rows(), HEAD).replace("-", "\u2212"))
kind("dashes as minus")(lambda: text(rows(), HEAD, sep=";").replace("-", "\u2013"))
kind("plus signs")(lambda: text(rows(form="+.4f"), HEAD))
kind("exponents")(lambda: text(rows(form=".9E"), HEAD))
kind("exponents of Fortran", suffix=".txt")(lambda: fixed(rows(form=".9e"), HEAD, width=20).replace("e", "D"))
kind("unit in the cell")(lambda: text(changed(rows(), POINT_CELLS, lambda c: f"{c} mm"), HEAD))
kind("degree sign in the cell")(lambda: text(changed(rows(), ANGLE_CELLS, lambda c: f"{c}°"), HEAD))
kind("formulas of text")(lambda: text([[f'="{cell}"' for cell in row] for row in rows()], HEAD))
kind("apostrophes before numbers")(lambda: text([[f"'{cell}" for cell in row] for row in rows()], HEAD))
kind("full-width digits")(
    lambda: ",".join(HEAD) + "\n" + text(rows()).translate({ord(c): ord(c) + 0xFEE0 for c in "0123456789.-"})
)


def sexagesimal(cell: str, form: str) -> str:
    """An angle in degrees, minutes and seconds."""
    tenths = round(abs(float(cell)) * 36000000)
    minutes, seconds = divmod(tenths, 600000)
    return ("-" if cell[0] == "-" else "") + form.format(*divmod(minutes, 60), seconds / 10000)


kind("degrees, minutes, seconds")(
    lambda: text(changed(rows(), ANGLE_CELLS, lambda c: sexagesimal(c, "{}°{:02d}'{:07.4f}\"")), HEAD)
)
kind("degrees, minutes, seconds with blanks")(
    lambda: text(changed(rows(), ANGLE_CELLS, lambda c: sexagesimal(c, "{} {:02d} {:07.4f}")), HEAD, sep=";")
)

# Decimal signs and thousands ------------------------------------------------------------------------------------------

kind("no-break space between thousands")(lambda: text(grouped(rows(), "\u00a0", ","), HEAD, sep=";"))
kind("narrow no-break space between thousands")(lambda: text(grouped(rows(), "\u202f", ","), HEAD, sep="\t"))
kind("blank between thousands")(lambda: text(grouped(rows(), " ", ","), HEAD, sep=";"))
kind("apostrophe between thousands")(lambda: text(grouped(rows(), "'"), HEAD, sep=";"))
kind("points between thousands")(lambda: text(grouped(rows(), ".", ","), HEAD, sep=";"))
kind("commas between thousands")(lambda: text([[f'"{c}"' for c in row] for row in grouped(rows(), ",")], HEAD))


def mixed(angles: Table, points: Table) -> Table:
    """Angles and points of two tables."""
    return [[*a[:6], *p[6:]] for a, p in zip(angles, points, strict=True)]


_WHOLE = rows(points=WHOLE, form=".0f")
kind("decimal commas, points between thousands of whole numbers", right_points=WHOLE)(
    lambda: text(mixed(comma(rows()), grouped(_WHOLE, ".")), HEAD, sep=";")
)
kind("decimal points, commas between thousands of whole numbers", right_points=WHOLE)(
    lambda: text(mixed(rows(), grouped(_WHOLE, ",")), HEAD, sep=";")
)
kind("1.235 beside -988", right_points=WHOLE, remedy={"thousands": "."})(
    lambda: text(mixed(rows(), grouped(_WHOLE, ".")), HEAD, sep=";")
)
kind("1,235 beside -988", right_points=WHOLE, right_angles=np.round(ANGLES), remedy={"thousands": ","})(
    lambda: text(mixed(rows(ANGLES, form=".0f"), grouped(_WHOLE, ",")), HEAD, sep=";")
)
_THREE = rows(form=".3f")
kind(
    "three decimals throughout",
    right_angles=np.array(_THREE, float)[:, :6],
    right_points=np.array(_THREE, float)[:, 6:],
)(lambda: text(_THREE, HEAD))

# Times and numbers of rows --------------------------------------------------------------------------------------------


def timed(stamp: Callable[[int], str]) -> Table:
    """Rows with a time in front."""
    return [[stamp(i), *row] for i, row in enumerate(rows())]


kind("numbers of rows")(lambda: text(counted(rows()), ["No.", *HEAD]))
kind("ISO time stamps")(lambda: text(timed(lambda i: f"2024-05-02T10:31:{i:02d}.125Z"), ["time", *HEAD]))
kind("German time stamps")(
    lambda: text([[f"02.05.2024 10:31:{i:02d}", *row] for i, row in enumerate(comma(rows()))], ["Zeit", *HEAD], sep=";")
)
kind("epoch time stamps")(lambda: text(timed(lambda i: f"17146{i:05d}.125"), ["stamp", *HEAD]))
kind("names of points with blanks", suffix=".txt")(
    lambda: text([[f"P {i}", *row] for i, row in enumerate(rows())], ["Name", *HEAD], sep="   ")
)
kind("names of points")(lambda: text([[f"P {i}", *row] for i, row in enumerate(rows())], ["Name", *HEAD], sep=";"))
