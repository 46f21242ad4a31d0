"""Controller deltas: what to add to the Denavit-Hartenberg constants that a controller has, as CSV or JSON.

A controller computes with its own constants; the nominal ones are stated too, so that a difference of conventions
shows. Many controllers have no beta. `without_beta_mm` states what leaving it out costs.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model, model_validator

from truearm.arm import Chain, DHTable
from truearm.arm.urdf_tree import MM_PER_M
from truearm.choices import Convention
from truearm.compensation.export.constants import FORMULAS, ROUNDING, after_comments
from truearm.compensation.export.constants_file import ConstantsFile, ConstantsRequest, reader, writer
from truearm.compensation.export.constants_table import ConstantsTable
from truearm.compensation.export.rigid_arm import RigidArm
from truearm.compensation.targets.manifest import MARKER, Manifest
from truearm.errors import InputError
from truearm.files.delimited import escape_formula

# Quantities of a row with their units; lengths also stand in metres, which most controllers have.
QUANTITIES = {"theta": "rad", "d": "mm", "a": "mm", "alpha": "rad", "beta": "rad", "b": "mm"}
IN_METRES = ("d", "a")
FRAMES_MARK = "# frames: "

_Number = Annotated[float, Field(allow_inf_nan=False)]
_Frame = Annotated[list[Annotated[list[_Number], Field(min_length=4, max_length=4)]], Field(min_length=4, max_length=4)]


class _Frames(BaseModel):
    """What a file has beside the rows of its joints; lengths in mm."""

    model_config = ConfigDict(extra="forbid")
    convention: Convention
    formula: str
    base: _Frame
    flange: _Frame
    tip_in_flange_mm: Annotated[list[_Number], Field(min_length=3, max_length=3)]
    without_beta_mm: _Number


class _Row(BaseModel):
    """Nominal constants of a joint and what to add to them."""

    model_config = ConfigDict(extra="forbid")
    joint: str
    type: Literal["revolute", "prismatic"]

    @model_validator(mode="after")
    def _says_one_thing(self) -> Self:
        for quantity in IN_METRES:
            in_mm, in_m = (getattr(self, f"delta_{quantity}_{unit}") for unit in ("mm", "m"))
            if abs(in_mm - MM_PER_M * in_m) > ROUNDING * max(1.0, abs(in_mm)):
                raise ValueError(f"delta_{quantity}_mm and delta_{quantity}_m differ")
        return self


_NAMES = [f"{quantity}_{unit}" for quantity, unit in QUANTITIES.items()]
_NAMES += [*(f"delta_{name}" for name in _NAMES), *(f"delta_{quantity}_m" for quantity in IN_METRES)]
if TYPE_CHECKING:
    _Joint = _Row
else:
    _Joint = create_model("_Joint", __base__=_Row, **dict.fromkeys(_NAMES, (_Number, ...)))


class _Document(BaseModel):
    model_config = ConfigDict(extra="forbid")
    frames: _Frames
    joints: Annotated[list[_Joint], Field(min_length=1, max_length=100)]


def _file_of(request: ConstantsRequest) -> ConstantsFile:
    """JSON if the file's name ends in ``.json``, else CSV."""
    rigid, table = request.table()
    document = _document_of(table, rigid)
    text = _json_text if request.path.suffix.lower() == ".json" else _csv_text
    return ConstantsFile(rigid, _table_of(document).chain(), partial(text, document))


def _chain_of(content: bytes, manifest: Manifest) -> Chain:
    try:
        text = content.decode("utf-8")
        document = _Document.model_validate(_from_csv(text, manifest) if text.startswith("#") else _from_json(text))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise InputError(f"the file is damaged: {where}: {first['msg']}") from None
    except InputError:
        raise
    except (UnicodeDecodeError, ValueError, RecursionError):
        raise InputError("the file is damaged", hint="export it again") from None
    if [one.joint for one in document.joints] != list(manifest.provenance.joint_names):
        raise InputError(f"expected rows of the joints {', '.join(manifest.provenance.joint_names)}")
    if document.frames.formula != FORMULAS[document.frames.convention]:
        raise InputError(f"expected the formula {FORMULAS[document.frames.convention]}")
    return _table_of(document).chain()


def _document_of(table: ConstantsTable, rigid: RigidArm) -> _Document:
    old, new = table.nominal, table.identified
    joints = []
    for row, name in enumerate(table.joint_names):
        numbers: dict[str, Any] = {"joint": name, "type": "prismatic" if new.prismatic[row] else "revolute"}
        for quantity, unit in QUANTITIES.items():
            was, now = (float(getattr(one, quantity)[row]) for one in (old, new))
            numbers |= {f"{quantity}_{unit}": was, f"delta_{quantity}_{unit}": now - was}
            if quantity in IN_METRES:
                numbers[f"delta_{quantity}_m"] = (now - was) / MM_PER_M
        joints.append(_Joint(**numbers))
    frames = _Frames(
        convention=new.convention,
        formula=FORMULAS[new.convention],
        base=new.base.tolist(),
        flange=new.flange.tolist(),
        tip_in_flange_mm=new.tip_in_flange.tolist(),
        without_beta_mm=_cost_of_beta(new, rigid),
    )
    return _Document(frames=frames, joints=joints)


def _cost_of_beta(table: DHTable, rigid: RigidArm) -> float:
    """Mean displacement of the tip over the region of an arm without beta and b [mm]."""
    plain = replace(table, beta=np.zeros(0), b=np.zeros(0))
    moved = plain.chain().tip_in_base(rigid.poses) - table.chain().tip_in_base(rigid.poses)
    return float(np.linalg.norm(moved, axis=1).mean())


def _table_of(document: _Document) -> DHTable:
    columns = {
        quantity: np.array(
            [getattr(one, f"{quantity}_{unit}") + getattr(one, f"delta_{quantity}_{unit}") for one in document.joints]
        )
        for quantity, unit in QUANTITIES.items()
    }
    return DHTable(
        document.frames.convention,
        **columns,
        prismatic=np.array([one.type == "prismatic" for one in document.joints]),
        base=np.array(document.frames.base),
        flange=np.array(document.frames.flange),
        tip_in_flange=np.array(document.frames.tip_in_flange_mm),
    )


def _json_text(document: _Document, manifest: Manifest) -> str:
    content: Mapping[str, Any] = {MARKER: manifest.model_dump(mode="json")} | document.model_dump(mode="json")
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _from_json(text: str) -> dict[str, Any]:
    found = json.loads(text)
    if not isinstance(found, dict):
        raise InputError("expected a JSON object")
    return {key: value for key, value in found.items() if key != MARKER}


def _csv_text(document: _Document, manifest: Manifest) -> str:
    text = io.StringIO()
    text.write(f"# {manifest.line()}\n{FRAMES_MARK}{document.frames.model_dump_json()}\n")
    rows = csv.DictWriter(text, list(_Joint.model_fields), lineterminator="\n")
    rows.writeheader()
    rows.writerows(one.model_dump(mode="json") | {"joint": escape_formula(one.joint)} for one in document.joints)
    return text.getvalue()


def _from_csv(text: str, manifest: Manifest) -> dict[str, Any]:
    comments, table = after_comments(text)
    frames = next((line.removeprefix(FRAMES_MARK) for line in comments if line.startswith(FRAMES_MARK)), None)
    if frames is None:
        raise InputError(f"expected a line {FRAMES_MARK.strip()} with base, flange and tip")
    names = {escape_formula(name): name for name in manifest.provenance.joint_names}
    rows = list(csv.DictReader(io.StringIO(table, newline="")))
    return {"frames": json.loads(frames), "joints": [row | {"joint": names.get(str(row.get("joint")))} for row in rows]}


write = writer("deltas", _file_of)
tips = reader(_chain_of)
