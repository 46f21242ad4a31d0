"""Tables as known programs write them: robots, instruments, mathematics and spreadsheets (registered as kinds)."""

from __future__ import annotations

import numpy as np

from benchmarks.table_kinds import (
    AXES,
    HEAD,
    JOINTS,
    METRES,
    NUMBERS,
    POINTS,
    RAD,
    N,
    comma,
    counted,
    fixed,
    grouped,
    kind,
    numbers_from,
    rows,
    text,
)

IN_RAD_AND_M = {"angle_unit": "rad", "point_unit": "m"}


def si(form: str = ".10f") -> list[list[str]]:
    """Cells in rad and m."""
    return rows(RAD, METRES, form)


# Robots ---------------------------------------------------------------------------------------------------------------

RTDE = [f"actual_q_{i}" for i in range(6)]
kind("UR RTDE", angles=RTDE, **IN_RAD_AND_M)(
    lambda: text([[f"{0.008 * i:.4f}", *row] for i, row in enumerate(si())], ["timestamp", *RTDE, *AXES], sep=" ")
)
KUKA = [f"A{i}" for i in range(1, 7)]
kind("KUKA", suffix=".txt", angles=KUKA)(lambda: text(rows(), [*KUKA, *AXES], sep=";"))
kind("KUKA E6AXIS", suffix=".dat", angles=KUKA, points=["X", "Y", "Z"])(
    lambda: "".join(
        f"DECL E6AXIS XP{i}={{" + ",".join(f"{n} {c}" for n, c in zip([*KUKA, *AXES], row, strict=True)) + "}\n"
        for i, row in enumerate(rows())
    )
)
kind("Fanuc", suffix=".txt")(
    lambda: "/PROG CALIB\n" + text([[f"P[{i}]", *row] for i, row in enumerate(rows(), 1)], ["Pos", *HEAD], sep="\t")
)
kind("Fanuc, labelled", suffix=".txt", angles=JOINTS)(
    lambda: "".join(
        ", ".join(f"{n}= {c} {u}" for n, c, u in zip(HEAD, row, ["deg"] * 6 + ["mm"] * 3, strict=True)) + "\n"
        for row in rows()
    )
)
kind("ABB jointtarget", suffix=".mod", right_points=np.full((N, 3), np.nan), angles=tuple("123456"), points=())(
    lambda: "".join(
        f"CONST jointtarget p{i}:=[[{','.join(row[:6])}],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];\n"
        for i, row in enumerate(rows())
    )
)
ROS = [f"field.position{i}" for i in range(6)]
ROS_POINT = [f"field.point.{axis}" for axis in "xyz"]
kind("rostopic echo -p", angles=ROS, points=ROS_POINT, **IN_RAD_AND_M)(
    lambda: text([[str(1714600000000000000 + i), *row] for i, row in enumerate(si())], ["%time", *ROS, *ROS_POINT])
)

# Instruments ----------------------------------------------------------------------------------------------------------

MOTIVE_POINT = [f"Position {axis}" for axis in AXES]
kind("Motive", points=MOTIVE_POINT, point_unit="m", angle_unit="rad")(
    lambda: text(
        [
            [str(i), f"{i / 120:.6f}", "0.1", "0.2", "0.3", "0.9", *row[6:], "0.0001", *row[:6]]
            for i, row in enumerate(si())
        ],
        [
            "Format Version",
            "1.23",
            "Take Name",
            "Take 2024-05-02",
            "Rotation Type",
            "Quaternion",
            "Length Units",
            "Meters",
        ],
        "",
        ["", "Type", *["Rigid Body"] * 8, *["Robot"] * 6],
        ["", "Name", *["Tip"] * 8, *["Angles"] * 6],
        ["", "ID", *["0123ABC"] * 8, *["77"] * 6],
        ["", "", *["Rotation"] * 4, *["Position"] * 3, "Mean Marker Error", *[""] * 6],
        ["Frame", "Time (Seconds)", "X", "Y", "Z", "W", "X", "Y", "Z", "", *JOINTS],
    )
)
kind("Vicon", angles=[*JOINTS], points=[f"Arm:Tip {axis}" for axis in AXES])(
    lambda: text(
        [[str(i), "0", *row[6:], "1.5", "2.5", "3.5", *row[:6]] for i, row in enumerate(rows(), 1)],
        "Trajectories",
        "100",
        ["", "", "Arm:Tip", "", "", "Arm:Base", "", "", "Arm", *[""] * 5],
        ["Frame", "Sub Frame", *AXES, *AXES, *JOINTS],
        ["", "", *["mm"] * 6, *["deg"] * 6],
    )
)
kind("Leica, Tracker Pilot", suffix=".txt", points=["X [mm]", "Y [mm]", "Z [mm]"])(
    lambda: text(
        [[f"P{i}", *row[6:], "0.015", *row[:6]] for i, row in enumerate(rows(), 1)],
        "Instrument: tracker, serial 751234",
        "Units: mm",
        "",
        ["Point", "X [mm]", "Y [mm]", "Z [mm]", "U95", *JOINTS],
        sep="\t",
    )
)
kind("SpatialAnalyzer", suffix=".txt", angles=("6", "7", "8", "9", "10", "11"), points=tuple("345"))(
    lambda: (
        "// Points exported from A::Main\n// Units: mm\n"
        + text([["A::Main", f"p{i}", *row[6:], *row[:6]] for i, row in enumerate(rows(), 1)], sep=", ")
    )
)
kind("PolyWorks", suffix=".txt", points=["Measured X", "Measured Y", "Measured Z"])(
    lambda: text(
        [[f"point {i}", *row[6:], *row[:6]] for i, row in enumerate(rows(), 1)],
        "PolyWorks report",
        ["Name", "Measured X", "Measured Y", "Measured Z", *JOINTS],
        sep=";",
    )
)
kind("LabVIEW measurement", suffix=".lvm")(
    lambda: text(
        [["", *row] for row in rows()],
        "LabVIEW Measurement",
        "Writer_Version\t2",
        "Separator\tTab",
        "Decimal_Separator\t.",
        "X_Columns\tNo",
        "***End_of_Header***",
        "",
        "Channels\t9",
        "***End_of_Header***",
        ["X_Value", *HEAD, "Comment"],
        sep="\t",
    )
)

# Mathematics ----------------------------------------------------------------------------------------------------------

kind("NumPy savetxt", suffix=".txt", **NUMBERS)(lambda: text(rows(form=".18e"), sep=" "))
kind("NumPy savetxt with header", suffix=".txt")(lambda: text(rows(form=".18e"), "# " + ",".join(HEAD)))
kind("NumPy print", suffix=".txt", **NUMBERS)(
    lambda: "[[" + "]\n [".join(" ".join(f"{c:>10}" for c in row) for row in rows()) + "]]\n"
)
kind("Python lists", suffix=".txt", **NUMBERS)(lambda: "".join(f"[{', '.join(row)}]\n" for row in rows()))
kind("Python dicts", suffix=".txt")(
    lambda: "".join(
        "{" + ", ".join(f"'{name}': {cell}" for name, cell in zip(HEAD, row, strict=True)) + "}\n" for row in rows()
    )
)
kind("pandas with index")(lambda: text(counted(rows(), 0), ["", *HEAD]))
kind("pandas without names", **numbers_from(1))(lambda: text(rows(), [str(i) for i in range(9)]))
kind("MATLAB writematrix", **NUMBERS)(lambda: text(rows(form=".15g")))
kind("MATLAB save -ascii", suffix=".txt", **NUMBERS)(
    lambda: "".join("".join(f"{c:>26}" for c in r) + "\n" for r in rows(form=".16e"))
)
kind("MATLAB writetable, tabs", suffix=".txt")(lambda: text(rows(form=".15g"), HEAD, sep="\t"))
kind("R write.csv")(
    lambda: text([[f'"{i}"', *row] for i, row in enumerate(rows(), 1)], ['""', *(f'"{name}"' for name in HEAD)])
)
kind("R write.table", suffix=".txt")(
    lambda: text([[f'"{i}"', *row] for i, row in enumerate(rows(), 1)], [f'"{name}"' for name in HEAD], sep=" ")
)
kind(
    "Fortran, fixed width with empty cells",
    suffix=".txt",
    right_points=np.where(np.arange(N)[:, None] == 3, np.nan, POINTS),
)(lambda: fixed(rows(points=np.where(np.arange(N)[:, None] == 3, np.nan, POINTS)), HEAD))
kind("Origin", suffix=".txt", angles=JOINTS)(
    lambda: text(rows(), HEAD, ["°"] * 6 + ["mm"] * 3, ["angle"] * 6 + ["point"] * 3, sep="\t")
)

# Spreadsheets ---------------------------------------------------------------------------------------------------------

kind("Excel, Germany")(lambda: text(comma(rows()), HEAD, sep=";", end="\r\n").encode("cp1252"))
kind("Excel, France")(lambda: text(grouped(rows(), "\u00a0", ","), HEAD, sep=";", end="\r\n").encode("cp1252"))
kind("Excel, Switzerland")(lambda: text(grouped(rows(), "\u2019"), HEAD, sep=";", end="\r\n").encode("cp1252"))
kind("Excel, India", right_points=POINTS * 100)(
    lambda: text([[*row[:6], *(f'"{lakhs(float(cell) * 100)}"' for cell in row[6:])] for row in rows()], HEAD)
)
kind("Excel, China")(lambda: text(counted(rows()), ["编号", *HEAD], end="\r\n").encode("gb18030"))
kind("Excel, United States")(
    lambda: text([[f'"{c}"' if "," in c else c for c in row] for row in grouped(rows(), ",")], HEAD, end="\r\n")
)
kind("Excel, Unicode text", suffix=".txt")(lambda: text(rows(), HEAD, sep="\t", end="\r\n").encode("utf-16"))


def lakhs(value: float) -> str:
    """A number as India groups it."""
    whole, fraction = f"{abs(value):.4f}".split(".")
    head, tail = whole[:-3], whole[-3:]
    while len(head) > 2:
        head, tail = head[:-2], f"{head[-2:]},{tail}"
    return ("-" if value < 0 else "") + (f"{head},{tail}" if head else tail) + f".{fraction}"
