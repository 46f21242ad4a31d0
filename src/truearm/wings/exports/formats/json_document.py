"""The form of a model in JSON: what every key is, its unit and shape. The schema in ``model.schema.json`` follows it.

The order of the keys is that of reading: what the file is, the arm, the chain with its terms, what remains unexplained,
and the conditions of the training. Lengths are in mm, angles in rad; a chain is composed as `truearm.arm.chain` says.
"""

from __future__ import annotations

import base64
import binascii
import dataclasses
import inspect
import math
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, Union, get_type_hints

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PlainValidator, WithJsonSchema, create_model, model_validator

from truearm.identification import terms
from truearm.identification.terms import Expression
from truearm.identification.terms.expression import INPUTS, OPERATIONS
from truearm.models.model_archive import symmetric
from truearm.typing import FloatArray
from truearm.wings.exports.targets.manifest import Manifest

SCHEMA = "https://json-schema.org/draft/2020-12/schema"
# A thousand terms are many. With more coefficients their functions at a thousand readings would not fit in the memory.
MAX_TERMS = 10_000
MAX_COEFFICIENTS = 20_000
# Up to this size a covariance is a list of rows, 0.1 MB of text that a person can read. That of 1,400 coefficients
# would be 21 MB of digits; base64 has 10, is read in a tenth of the time and loses no bit.
MAX_LISTED = 100

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(allow_inf_nan=False, gt=0)]
NotNegative = Annotated[float, Field(allow_inf_nan=False, ge=0)]
Count = Annotated[int, Field(ge=0)]
LONGEST_TEXT = 1000
Text = Annotated[str, Field(max_length=LONGEST_TEXT)]
Name = Annotated[str, Field(min_length=1, max_length=1000)]
Vector = Annotated[list[Finite], Field(min_length=3, max_length=3)]
Row = Annotated[list[Finite], Field(min_length=4, max_length=4)]
RigidMotion = Annotated[list[Row], Field(min_length=4, max_length=4)]
ByJoint = Annotated[list[Finite], Field(min_length=1, max_length=100)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")

    @model_validator(mode="before")
    @classmethod
    def _arrays_as_lists(cls, data: Any) -> Any:
        if isinstance(data, dict):
            return {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in data.items()}
        return data

    @classmethod
    def of(cls, thing: object, **more: Any) -> Self:
        """The form of a thing with attributes of the same names, but for those in `more`."""
        return cls.model_validate({name: getattr(thing, name) for name in cls.model_fields if name not in more} | more)


class Units(_Strict):
    """Units of all numbers whose key names none."""

    length: Literal["mm"] = "mm"
    angle: Literal["rad"] = "rad"
    temperature: Literal["degC"] = "degC"
    torque: Literal["N m"] = "N m"


class Joint(_Strict):
    """A joint: it turns about the z axis of its place [rad], or slides along it [mm]."""

    name: Name
    kind: Literal["revolute", "prismatic"]
    lower: Finite | None
    upper: Finite | None
    working: Finite


class Chain(_Strict):
    """F0 J1(q1) F1 ... Jn(qn) Fn tip: the rigid motions F as matrices, translations in mm, and the tip after Fn."""

    fixed: Annotated[list[RigidMotion], Field(min_length=2, max_length=101)]
    tip_in_flange_mm: Vector


class DenavitHartenberg(_Strict):
    """One row a joint, between the motions of base and flange; beta and b are zero but for nearly parallel axes.

    A row is Rz(q + theta) Tz(d) Tx(a) Ty(b) Rx(alpha) Ry(beta) in the standard convention ("dh"), and Tx(a) Ty(b)
    Rx(alpha) Ry(beta) Rz(q + theta) Tz(d) in the modified one ("mdh"). A sliding joint adds q to d.
    """

    convention: Literal["dh", "mdh"]
    a_mm: ByJoint
    d_mm: ByJoint
    alpha_rad: ByJoint
    theta_rad: ByJoint
    beta_rad: ByJoint
    b_mm: ByJoint
    base: RigidMotion
    flange: RigidMotion
    tip_mm: Vector


class Arm(_Strict):
    """The nominal arm in its own base frame.

    Gravity torques are those of its links: of the masses that joint i moves, with their centres along the axes of place
    i. Where the masses are not known, they are 1 kg per metre of link; where they are, the last one has the payload of
    the training.
    """

    name: Text
    title: Text
    serial_number: Text
    source: Text
    joints: Annotated[list[Joint], Field(min_length=1, max_length=100)]
    chain: Chain
    denavit_hartenberg: DenavitHartenberg | None
    masses_are_known: bool
    mass_kg: ByJoint
    centre_in_joint_mm: Annotated[list[Vector], Field(max_length=100)]
    gravity_in_base_m_s2: Vector


def _form_of(basis: type[terms.Basis], **fields: Any) -> type[BaseModel]:
    """The form of a basis: its class as its kind, and the fields of the class, whose types say what they may be."""
    hints = get_type_hints(basis, include_extras=True)
    typed = {field.name: (fields.get(field.name, hints[field.name]), ...) for field in dataclasses.fields(basis)}  # type: ignore[arg-type]
    kind: Any = Literal[basis.__name__]
    return create_model(basis.__name__, __base__=_Strict, __doc__=inspect.getdoc(basis), kind=(kind, ...), **typed)  # type: ignore[call-overload, no-any-return]


# A function of the state as `Expression.as_data` has it. An exported model is at the payload of its training.
_EXPRESSION = {
    "anyOf": [
        {"type": "number"},
        {
            "type": "array",
            "prefixItems": [{"enum": [kind for kind in (*INPUTS, *OPERATIONS) if kind != "payload torque"]}],
            "minItems": 2,
        },
    ],
    "description": "A number, or a list of an operation and what it is of: expressions, of a power also its exponent; "
    "of an input its joint (from 1; of a torque 0 is the base), link, axis (0, 1, 2) or name. Angles q are "
    "in rad, of sliding joints in mm; torques in N m; temperatures in K above 20 degC; sessions and tips are 1 or 0.",
}
ExpressionForm = Annotated[
    Any, PlainValidator(lambda data: Expression.from_data(data).as_data()), WithJsonSchema(_EXPRESSION)
]
# Bases that readers know by name; any other is written as a Formula.
NAMED: tuple[type[terms.Basis], ...] = (
    *(terms.Constant, terms.Harmonics, terms.GravityTorque, terms.Temperature, terms.Direction, terms.InSession),
    *(terms.Column, terms.InducedProcess),
)
# Types of fields that their classes check themselves.
_FIELDS: dict[type[terms.Basis], dict[str, Any]] = {
    terms.InducedProcess: {
        "angles": Annotated[list[Finite], Field(min_length=1, max_length=100_000)],
        "length_scales": Annotated[list[Positive], Field(min_length=1, max_length=100)],
        "sliding": Annotated[list[Annotated[int, Field(ge=1, le=100)]], Field(max_length=100)],
    },
    terms.Formula: {"functions": Annotated[list[ExpressionForm], Field(min_length=1, max_length=MAX_COEFFICIENTS)]},
}
_FORMS = tuple(_form_of(basis, **_FIELDS.get(basis, {})) for basis in (*NAMED, terms.Formula))
if TYPE_CHECKING:
    Basis = Any
else:
    Basis = Annotated[Union[_FORMS], Field(discriminator="kind")]  # noqa: UP007 (a union of what a tuple has)


class UncertainTerm(_Strict):
    """A term that moves nothing by its mean: its coefficients are zero, and only their covariance is not."""

    name: Name
    place: Annotated[int, Field(ge=0, le=101)]
    direction: Annotated[list[Finite], Field(min_length=6, max_length=6)]
    basis: Basis


class Term(UncertainTerm):
    """Small motions at a place: direction (rotation vector, translation) times the sum of coefficients times functions.

    Places are 0 the base, i joint i, n + 1 the tip. The motion at a place is the sum of its terms; it turns by its
    rotation vector and shifts then. Coefficients are in rad or mm per unit of their function.
    """

    group: Name
    functions: list[Text]
    coefficients: list[Finite]
    standard_uncertainties: list[NotNegative]
    prior_standard_deviations: list[Positive]
    prior_is_scaled_by_evidence: bool

    @model_validator(mode="after")
    def _lengths_agree(self) -> Self:
        lists = (self.functions, self.coefficients, self.standard_uncertainties, self.prior_standard_deviations)
        if len({len(one) for one in lists}) != 1:
            raise ValueError("expected one coefficient, uncertainty, prior and name for each function of a term")
        return self


class ListedMatrix(_Strict):
    """Lower triangle of a symmetric matrix: row i has i + 1 numbers."""

    encoding: Literal["rows"]
    size: Count
    lower_triangle: Annotated[list[list[Finite]], Field(max_length=MAX_LISTED)]

    @model_validator(mode="after")
    def _is_a_triangle(self) -> Self:
        if [len(row) for row in self.lower_triangle] != list(range(1, self.size + 1)):
            raise ValueError(f"expected {self.size} rows of a lower triangle, row i with i + 1 numbers")
        return self

    def matrix(self) -> FloatArray:
        """The whole matrix."""
        return symmetric(np.array([one for row in self.lower_triangle for one in row], dtype=float))


class PackedMatrix(_Strict):
    """Lower triangle of a symmetric matrix, row after row, as little-endian doubles in base64."""

    encoding: Literal["base64-float64"]
    size: Count
    lower_triangle: str

    @model_validator(mode="after")
    def _is_a_triangle(self) -> Self:
        if self.size > MAX_COEFFICIENTS or len(self.lower_triangle) > 4 * math.ceil(self._n_bytes / 3):
            raise ValueError(f"expected a lower triangle of {self.size} rows in base64")
        try:
            n_bytes = len(base64.b64decode(self.lower_triangle, validate=True))
        except binascii.Error:
            raise ValueError("expected a lower triangle in base64") from None
        if n_bytes != self._n_bytes or not np.isfinite(self._numbers()).all():
            raise ValueError(f"expected {self._n_bytes} bytes of finite doubles in base64, got {n_bytes} bytes")
        return self

    def matrix(self) -> FloatArray:
        """The whole matrix."""
        return symmetric(self._numbers())

    @property
    def _n_bytes(self) -> int:
        return 4 * self.size * (self.size + 1)

    def _numbers(self) -> FloatArray:
        return np.frombuffer(base64.b64decode(self.lower_triangle), dtype="<f8")


SymmetricMatrix = Annotated[ListedMatrix | PackedMatrix, Field(discriminator="encoding")]


def symmetric_matrix(matrix: FloatArray) -> ListedMatrix | PackedMatrix:
    """A symmetric matrix, listed where it is small and packed where it is large."""
    size = len(matrix)
    if size <= MAX_LISTED:
        rows = [row[: i + 1].tolist() for i, row in enumerate(matrix)]
        return ListedMatrix(encoding="rows", size=size, lower_triangle=rows)
    packed = matrix[np.tril_indices(size)].astype("<f8").tobytes()
    return PackedMatrix(encoding="base64-float64", size=size, lower_triangle=base64.b64encode(packed).decode())


class Extrapolation(_Strict):
    """Growth of the residual variance outside the trained ranges: 1 + growth d + nominal c times that inside.

    Here d is the root of the sum of the squares of the joints' distances from their ranges: turning joints in rad on
    the circle, sliding ones in units of their range or of 1 mm, whichever is longer; c is (d - 0.6) / 0.6 clipped to
    0 and 1.
    """

    ranges: Annotated[
        list[Annotated[list[Finite], Field(min_length=2, max_length=2)]], Field(min_length=1, max_length=100)
    ]
    growth: NotNegative
    nominal: NotNegative = 0.0


class VarianceFunction(_Strict):
    """Share of the residual variance at given joints: exp(slope z + curvature (z^2 - 1)) / mean.

    Here z is (q - centre) / spread, clipped to +-2; q of a turning joint outside its range is moved by full turns to be
    near the range's middle. The share is at least 1 where a joint is more than 3 spreads from
    its centre. Where joints are beyond their trained ranges it grows.
    """

    centre: ByJoint
    spread: ByJoint
    slope: ByJoint
    curvature: ByJoint
    mean: Positive
    beyond: Extrapolation | None = None


class Identified(_Strict):
    """The chain as placed in the frame of the reference, with its terms, and what remains unexplained.

    The covariance is of all coefficients, term after term, those of the uncertain terms last. The variance of a
    coordinate is that which follows from it, and the square of the residual standard deviation times the share at the
    joints.
    """

    chain: Chain
    terms: Annotated[list[Term], Field(max_length=MAX_TERMS)]
    uncertain_terms: Annotated[list[UncertainTerm], Field(max_length=MAX_TERMS)] = []
    covariance: SymmetricMatrix
    residual_standard_deviation_mm: NotNegative
    variance_function: VarianceFunction
    birge_ratio: Annotated[float, Field(allow_inf_nan=False, ge=1)]
    skipped_terms: Annotated[dict[str, Text], Field(description="Terms that were not offered, and why.")]


class Range(_Strict):
    """What scales a quantity onto -1 to 1."""

    lower: ByJoint
    upper: ByJoint


class Member(_Strict):
    """One network: for each layer of weights (inputs + 1) rows, one column a unit; the bias is the last row."""

    layers: Annotated[list[list[list[Finite]]], Field(min_length=2, max_length=100)]
    basis_covariance: SymmetricMatrix


class Network(_Strict):
    """Perceptrons on scaled joints; the prediction is the mean of their outputs, scaled back to mm."""

    activations: list[Literal["tansig", "logsig", "purelin"]]
    joint_range: Range
    point_range_mm: Range
    members: Annotated[list[Member], Field(min_length=1, max_length=1000)]
    residual_covariance_mm2: Annotated[list[Vector], Field(min_length=3, max_length=3)]


class StatedInput(_Strict):
    """A number that readings may state: its mean in training, which applies where it is not stated, and its range."""

    mean: Finite
    variance: NotNegative
    lower: Finite
    upper: Finite


class Gap(_Strict):
    """A wide gap between the training angles of a joint (counted from 1)."""

    joint: Annotated[int, Field(ge=1, le=100)]
    lower: Finite
    upper: Finite


class Training(_Strict):
    """Conditions under which the model was trained.

    Where angles were rounded, angle_std has the standard uncertainty of each by that: to the variance of a tip from
    angles rounded so, add the squares of its derivatives by the angles times angle_std.
    """

    n_readings: Count
    joint_ranges: Annotated[list[Annotated[list[Finite], Field(min_length=2, max_length=2)]], Field(max_length=100)]
    joint_gaps: list[Gap]
    temperature_degC: StatedInput | None
    columns: dict[str, StatedInput]
    has_directions: bool
    free_parts: list[Literal["base", "tip"]]
    readings_sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    angle_std: Annotated[list[NotNegative], Field(min_length=1, max_length=100)] | None = None


class ModelDocument(_Strict):
    """A fitted model of an articulated arm, whole: whoever reads this file needs neither truearm nor the readings.

    Points are in the frame of the reference instrument; of several sessions, in that of the first, and session_frames
    has the rigid motion of each session's points into it.
    """

    model_config = ConfigDict(extra="forbid", populate_by_name=True, title="A model of an articulated arm by truearm")
    manifest: Manifest = Field(alias="truearm-export")
    format: Literal["truearm-model"]
    version: Literal[1, 2]
    units: Units
    model: Literal["nominal", "kinematic", "physical", "network"]
    arm: Arm
    reference_chain: Chain = Field(description="The nominal arm with base and tip identified: before compensation.")
    identified: Identified | None
    network: Network | None
    session_frames: dict[str, RigidMotion]
    training: Training

    @model_validator(mode="after")
    def _is_one_model(self) -> Self:
        if (self.identified is None) == (self.network is None) or (self.network is None) == (self.model == "network"):
            raise ValueError("expected a network of a network model, and an identified chain of any other")
        placed = [] if self.identified is None else [self.identified.chain]
        if {len(chain.fixed) for chain in (self.arm.chain, self.reference_chain, *placed)} != {
            len(self.arm.joints) + 1
        }:
            raise ValueError(f"expected chains of {len(self.arm.joints)} joints, with one fixed motion more")
        return self


def schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of the document."""
    return {"$schema": SCHEMA} | ModelDocument.model_json_schema(by_alias=True)
