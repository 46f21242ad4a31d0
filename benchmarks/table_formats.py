"""Tables in workbooks, arrays, records and logs, beside those of text (registered as kinds)."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import scipy.io

from benchmarks.table_kinds import ANGLES, HEAD, LOST, METRES, POINTS, RAD, comma, kind, rows

READINGS = np.hstack([ANGLES, POINTS])
Sheet = Sequence[Sequence[object]]
WORKBOOK = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
RELATIONS = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
ODF = "urn:oasis:names:tc:opendocument:xmlns"
UNITS = ["deg"] * 6 + ["mm"] * 3
IN_RAD_AND_M = {"angle_unit": "rad", "point_unit": "m"}


def archive(members: Mapping[str, str | bytes]) -> bytes:
    """A zip archive."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, member in members.items():
            packed.writestr(name, member)
    return data.getvalue()


def xlsx(sheets: Mapping[str, Sheet]) -> bytes:
    """A workbook of Office Open XML, as ECMA-376 has it at the least."""
    numbered = list(enumerate(sheets.items(), 1))
    listed = "".join(f'<sheet name="{escape(name)}" sheetId="{i}" r:id="r{i}"/>' for i, (name, _) in numbered)
    targets = "".join(
        f'<Relationship Id="r{i}" Type="{RELATIONS}/worksheet" Target="worksheets/sheet{i}.xml"/>' for i, _ in numbered
    )
    package = "http://schemas.openxmlformats.org/package/2006"
    main = f'<Relationship Id="r1" Type="{RELATIONS}/officeDocument" Target="xl/workbook.xml"/>'
    return archive(
        {
            "[Content_Types].xml": f'<Types xmlns="{package}/content-types"/>',
            "_rels/.rels": f'<Relationships xmlns="{package}/relationships">{main}</Relationships>',
            "xl/workbook.xml": f'<workbook xmlns="{WORKBOOK}" xmlns:r="{RELATIONS}">'
            f"<sheets>{listed}</sheets></workbook>",
            "xl/_rels/workbook.xml.rels": f'<Relationships xmlns="{package}/relationships">{targets}</Relationships>',
            **{f"xl/worksheets/sheet{i}.xml": _worksheet(sheet) for i, (_, sheet) in numbered},
        }
    )


def _worksheet(sheet: Sheet) -> str:
    def cell(place: str, value: object) -> str:
        if isinstance(value, bool):
            return f'<c r="{place}" t="b"><v>{value:d}</v></c>'
        if isinstance(value, int | float):
            return "" if value != value else f'<c r="{place}"><v>{value!r}</v></c>'
        if value in ("#DIV/0!", "#N/A"):
            return f'<c r="{place}" t="e"><v>{value}</v></c>'
        return f'<c r="{place}" t="inlineStr"><is><t>{escape(str(value))}</t></is></c>' if value != "" else ""

    lines = (
        f'<row r="{i}">{"".join(cell(f"{chr(65 + k)}{i}", value) for k, value in enumerate(row))}</row>'
        for i, row in enumerate(sheet, 1)
    )
    return f'<worksheet xmlns="{WORKBOOK}"><sheetData>{"".join(lines)}</sheetData></worksheet>'


def ods(sheets: Mapping[str, Sheet]) -> bytes:
    """A workbook of OpenDocument, with the empty rest of each sheet as LibreOffice writes it."""

    def cell(value: object) -> str:
        if isinstance(value, float | int):
            shown = f' office:value-type="float" office:value="{value!r}"'
            return "<table:table-cell/>" if value != value else f"<table:table-cell{shown}/>"
        return f'<table:table-cell office:value-type="string"><text:p>{escape(str(value))}</text:p></table:table-cell>'

    rest = '<table:table-cell table:number-columns-repeated="16384"/></table:table-row>'
    tables = "".join(
        f'<table:table table:name="{escape(name)}">'
        + "".join(f"<table:table-row>{''.join(map(cell, row))}</table:table-row>" for row in sheet)
        + f'<table:table-row table:number-rows-repeated="1048000">{rest}</table:table>'
        for name, sheet in sheets.items()
    )
    spaces = " ".join(f'xmlns:{name}="{ODF}:{name}:1.0"' for name in ("office", "text", "table"))
    return archive(
        {
            "mimetype": "application/vnd.oasis.opendocument.spreadsheet",
            "META-INF/manifest.xml": f'<manifest:manifest xmlns:manifest="{ODF}:manifest:1.0"/>',
            "content.xml": f"<office:document-content {spaces}><office:body><office:spreadsheet>{tables}"
            "</office:spreadsheet></office:body></office:document-content>",
        }
    )


def saved(write: Callable[[io.BytesIO], object]) -> bytes:
    """What a function writes to a file."""
    data = io.BytesIO()
    write(data)
    return data.getvalue()


def frame() -> Any:
    """The readings as a data frame."""
    import pandas as pd

    return pd.DataFrame(READINGS, columns=HEAD)


def records() -> list[dict[str, Any]]:
    """A record a reading."""
    return [
        {"q": q.tolist(), "tip": dict(zip("xyz", p.tolist(), strict=True))} for q, p in zip(RAD, METRES, strict=True)
    ]


TYPED = READINGS.tolist()
TITLED = [["Cell 4, measured in May"], [], HEAD, UNITS]
Q, P, TIP = [f"q[{i}]" for i in range(6)], [f"p[{i}]" for i in range(3)], [f"tip.{axis}" for axis in "xyz"]
FEW = {"angles": Q, "points": P}

kind("workbook", suffix=".xlsx")(lambda: xlsx({"Tabelle1": [HEAD, *TYPED]}))
kind("workbook with a title, units, means and another sheet", suffix=".xlsx")(
    lambda: xlsx(
        {"Notes": [["The tracker was warm."]], "Data": [*TITLED, *TYPED, ["Mean", *READINGS.mean(axis=0)[1:].tolist()]]}
    )
)
kind("workbook with errors for lost targets", suffix=".xlsx", right_points=LOST)(
    lambda: xlsx(
        {"A": [HEAD, *[["#DIV/0!" if v != v else v for v in row] for row in np.hstack([ANGLES, LOST]).tolist()]]}
    )
)
kind("workbook of text with decimal commas", suffix=".xlsx")(lambda: xlsx({"A": [HEAD, *comma(rows())]}))
kind("workbook of text with decimal commas beside numbers", suffix=".xlsx")(
    lambda: xlsx({"A": [HEAD, *[[*typed[:6], *text[6:]] for typed, text in zip(TYPED, comma(rows()), strict=True)]]})
)
kind("workbook named .csv", suffix=".csv")(lambda: xlsx({"A": [HEAD, *TYPED]}))
kind("workbook, one of two sheets alike", suffix=".xlsx", options={"part": "Tuesday"})(
    lambda: xlsx({"Monday": [HEAD, *TYPED[::-1]], "Tuesday": [HEAD, *TYPED]})
)
kind("OpenDocument workbook", suffix=".ods")(lambda: ods({"Tabelle1": [*TITLED, *TYPED]}))
kind("Parquet", suffix=".parquet")(lambda: saved(frame().to_parquet))
kind("Feather", suffix=".feather")(lambda: saved(frame().to_feather))
kind("NumPy array", suffix=".npy", angles=tuple("123456"), points=tuple("789"))(
    lambda: saved(lambda file: np.save(file, READINGS))
)
kind("NumPy archive", suffix=".npz", **FEW)(lambda: saved(lambda file: np.savez(file, q=ANGLES, p=POINTS, T=np.eye(4))))
kind("NumPy structured array", suffix=".npy", **FEW)(
    lambda: saved(
        lambda file: np.save(file, np.rec.fromarrays([ANGLES, POINTS], dtype=[("q", "f8", 6), ("p", "f8", 3)]))
    )
)
kind("MATLAB", suffix=".mat", **FEW)(
    lambda: saved(lambda file: scipy.io.savemat(file, {"q": ANGLES, "p": POINTS, "rate": 125.0}, do_compression=True))
)
kind("MATLAB, a reading a column", suffix=".mat", **FEW)(
    lambda: saved(lambda file: scipy.io.savemat(file, {"q": ANGLES.T, "p": POINTS.T}))
)
kind("MATLAB struct", suffix=".mat", angles=[f"run.{q}" for q in Q], points=[f"run.{p}" for p in P])(
    lambda: saved(lambda file: scipy.io.savemat(file, {"run": {"q": ANGLES, "p": POINTS, "robot": "UR5"}}))
)
kind("JSON lines", suffix=".jsonl", angles=Q, points=TIP, **IN_RAD_AND_M)(lambda: "\n".join(map(json.dumps, records())))
kind("JSON records", suffix=".json", angles=Q, points=TIP, **IN_RAD_AND_M)(
    lambda: json.dumps({"robot": "UR5", "readings": records()}, indent=1)
)
kind("JSON arrays", suffix=".json", **FEW)(
    lambda: json.dumps({"q": ANGLES.tolist(), "p": POINTS.tolist(), "rate": 125})
)
kind("JSON JointState", suffix=".jsonl", angles=[f"joint_{i}/position" for i in range(6)], angle_unit="rad", points=())(
    lambda: "\n".join(
        json.dumps({"stamp": i, "name": [f"joint_{k}" for k in range(6)], "position": q.tolist(), "velocity": []})
        for i, q in enumerate(RAD)
    )
)
