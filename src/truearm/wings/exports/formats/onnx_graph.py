"""A fitted model as an ONNX graph in double precision (opset 17, IR 8): joint angles in, coordinates of the tip out.

The graph composes the same finite motions as `PerturbedChain`, from the tip to the base: it is the model itself, not an
approximation. Poses are the columns of every matrix inside. Only operators that onnxruntime runs in double precision
occur (`OPERATORS`); ``Atan`` is not one of them.

The covariance is not in the graph: it needs the derivatives of the tip by every coefficient and the root of their
covariance, for the physical model of a robot some 10 MB and a thousand times the work of the point.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from truearm import __version__
from truearm.arm import Chain
from truearm.errors import InputError, extra_module
from truearm.files.atomic_write import atomic_file
from truearm.files.file_reading import read_limited
from truearm.identification.terms import Expression, link_vectors
from truearm.models import Compensator, IdentifiedModel, NetworkModel
from truearm.readings.thermal_expansion import REFERENCE_DEGC
from truearm.typing import FloatArray
from truearm.wings.exports.formats.plain_model import ONE, PlainModel, plain_model
from truearm.wings.exports.targets.manifest import MARKER, Manifest, read_manifest

OPSET = 17
IR_VERSION = 8
OPERATORS = frozenset({
    *("Add", "Concat", "Cos", "Div", "Gather", "Gemm", "MatMul", "Mul", "Sin", "Split", "Sqrt", "Sub", "Tanh"),
    *("Transpose", "Unsqueeze"),
})  # fmt: skip
# The physical model of a robot has 0.1 MB, a network of two layers of 1000 units 8 MB.
MAX_BYTES = 64 * 2**20
# Numbers of an intermediate value for each pose: a layer of 1000 units has 1000.
MAX_VALUES = 100_000
# Added to the square of an angle before its root is taken: sin(t) / t is then 1 at zero, and changes by a sixth of this
# elsewhere. A number below those of single precision would be optimised away by onnxruntime as a zero.
TINY = 1e-30

# Rz(q) = ALONG cos q + ACROSS sin q + AXIS
ALONG, ACROSS, AXIS = np.diag([1.0, 1.0, 0.0]), np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]]), np.diag([0.0, 0.0, 1.0])


def write(model: Compensator, manifest: Manifest, path: str | Path) -> None:
    """Write a fitted model as an ONNX graph.

    Inputs are ``joints`` (n, n_joints) [rad, mm], and where terms depend on them ``temperature_degC`` (n,),
    ``directions`` (n, n_joints) and columns (n,) by their names. All but ``joints`` have a default: the mean of the
    training, and the middle between the two directions. The output is ``tip_mm`` (n, 3) in the frame of
    `Compensator.predict`.

    Parameters
    ----------
    model : Compensator
        Fitted.
    manifest : Manifest
        Goes into the metadata of the file.
    path : path

    Raises
    ------
    MissingTool
        If the package onnx is not installed.
    InputError
        If a term has a basis without expressions.
    """
    onnx = _package("onnx")
    graph = _Graph(onnx.helper, model.arm_.n_joints)
    if isinstance(model, NetworkModel):
        tip = _network_tip(graph, model)
    else:
        tip = _ChainGraph(graph, plain_model(_of_mean(model))).tip()
    content = graph.serialized(graph.node("Transpose", tip, output="tip_mm", perm=[1, 0]), model, manifest)
    with atomic_file(path, read=read_manifest) as temporary:
        temporary.write_bytes(content)


def tips(path: str | Path, joints: npt.ArrayLike, **states: npt.ArrayLike) -> FloatArray:
    """Evaluate a written file with onnxruntime.

    Parameters
    ----------
    path : path
    joints : (n, n_joints) array
        [rad, or mm].
    **states : array
        Further inputs of the graph; their defaults where they are not given.

    Returns
    -------
    (n, 3) array
        [mm].

    Raises
    ------
    MissingTool
        If onnx or onnxruntime is not installed.
    InputError
        If the file is no such graph.
    """
    onnx, runtime = _package("onnx"), _package("onnxruntime")
    content = read_limited(path, limit_bytes=MAX_BYTES)
    n_joints = _check_graph(onnx, content, path)
    angles = np.asarray(joints, dtype=float)
    if angles.ndim != 2 or angles.shape[1] != n_joints:
        raise InputError(f"expected joints of shape (n, {n_joints}), got {angles.shape}", file=path)
    try:
        options = runtime.SessionOptions()
        options.log_severity_level = 4  # its faults come as exceptions; a default value of an input is none
        session = runtime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        given = {name: np.asarray(values, dtype=float) for name, values in states.items()}
        out = np.asarray(session.run(["tip_mm"], {"joints": angles, **given})[0])
    except Exception as error:  # onnxruntime has an exception of its own for every kind of fault
        raise InputError(f"onnxruntime does not run the graph ({_first_line(error)})", file=path) from None
    if out.shape != (len(angles), 3) or not np.isfinite(out).all():
        raise InputError(f"expected finite tips of shape ({len(angles)}, 3) from the graph, got {out.shape}", file=path)
    return out


def _package(name: str) -> Any:
    package = name.partition(".")[0]
    return extra_module(name, f"ONNX files need the package {package}", f"pip install {package}")


def _check_graph(onnx: Any, content: bytes, path: str | Path) -> int:
    """Number of joints of a graph as `write` writes it; anything else is refused before it runs.

    No loops, no functions, no data in other files and no large intermediate values: a graph from somebody else cannot
    read a file, run for ever or fill the memory.
    """
    try:
        onnx.checker.check_model(content)
        model = onnx.shape_inference.infer_shapes(onnx.load_model_from_string(content), strict_mode=True)
    except Exception as error:  # protobuf and the checker have exceptions of their own
        raise InputError(f"the file is not an ONNX graph ({_first_line(error)})", file=path) from None
    graph = model.graph
    foreign = {node.op_type for node in graph.node} - OPERATORS | {node.domain for node in graph.node} - {""}
    outside = [tensor.name for tensor in graph.initializer if tensor.data_location == onnx.TensorProto.EXTERNAL]
    if foreign or outside or model.functions or graph.sparse_initializer:
        raise InputError(f"the graph has parts that truearm does not write: {sorted(foreign) or 'data'}", file=path)
    shapes = {value.name: _shape(value) for value in (*graph.input, *graph.value_info, *graph.output)}
    joints = shapes.get("joints", ())
    if len(joints) != 2 or joints[1] < 1 or [value.name for value in graph.output] != ["tip_mm"]:
        raise InputError("expected a graph from joints (n, n_joints) to tip_mm", file=path)
    values = [shapes.get(name, (MAX_VALUES + 1,)) for node in graph.node for name in node.output]
    if max(map(math.prod, values), default=0) > MAX_VALUES:
        raise InputError(f"the graph has intermediate values of more than {MAX_VALUES} numbers a pose", file=path)
    return joints[1]


def _shape(value: Any) -> tuple[int, ...]:
    """Shape of a value of a graph; 1 where it is the number of poses."""
    return tuple(int(size.dim_value) or 1 for size in value.type.tensor_type.shape.dim)


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:120]


class _Graph:
    """Nodes, constants and inputs of a graph; every name is used once."""

    def __init__(self, helper: Any, n_joints: int) -> None:
        self.helper = helper
        self.nodes: list[Any] = []
        self.constants: dict[str, npt.NDArray[Any]] = {}
        self.inputs: list[Any] = []
        self.joints = self.node("Transpose", self.input("joints", ("n", n_joints), "rad, or mm of sliding joints"))

    def input(self, name: str, shape: Sequence[int | str | None], doc: str, default: FloatArray | None = None) -> str:
        """Add an input of doubles; one with a default may be omitted."""
        double = 11  # TensorProto.DOUBLE
        self.inputs.append(self.helper.make_tensor_value_info(name, double, shape, doc_string=doc))
        if default is not None:
            self.constants[name] = default
        return name

    def constant(self, array: npt.ArrayLike) -> str:
        """Name of a constant of doubles."""
        return self._constant(np.array(array, dtype=float))

    def node(self, operator: str, *inputs: str, output: str = "", **attributes: Any) -> str:
        """Add a node with one output."""
        name = output or f"node.{len(self.nodes)}"
        self.nodes.append(self.helper.make_node(operator, list(inputs), [name], **attributes))
        return name

    def split(self, value: str, n: int) -> list[str]:
        """`n` equal blocks of rows."""
        names = [f"node.{len(self.nodes)}.{i}" for i in range(n)]
        self.nodes.append(self.helper.make_node("Split", [value], names, axis=0))
        return names

    def rows(self, value: str, which: Sequence[int]) -> str:
        """The rows of a matrix."""
        return self.node("Gather", value, self._constant(np.array(which, dtype=np.int64)), axis=0)

    def row(self, values: str) -> str:
        """Values (n,) as a row (1, n)."""
        return self.node("Unsqueeze", values, self._constant(np.array([0])))

    def affine(self, matrix: FloatArray, value: str, offset: FloatArray) -> str:
        """``matrix @ value + offset``, the offset a column for all poses."""
        if not offset.any():
            return self.node("MatMul", self.constant(matrix), value)
        return self.node("Gemm", self.constant(matrix), value, self.constant(offset[:, None]))

    def sum(self, *values: str) -> str:
        """The sum, with constants over poses repeated."""
        total, *others = values
        for other in others:
            total = self.node("Add", total, other)
        return total

    def product(self, a: str, b: str) -> str:
        """The product, element by element."""
        return self.node("Mul", a, b)

    def cross(self, a: str, b: str) -> str:
        """Products a x b of vectors (3, n)."""
        first = self.product(self.rows(a, (1, 2, 0)), self.rows(b, (2, 0, 1)))
        return self.node("Sub", first, self.product(self.rows(a, (2, 0, 1)), self.rows(b, (1, 2, 0))))

    def serialized(self, output: str, model: Compensator, manifest: Manifest) -> bytes:
        """The file: the graph from its inputs to `output`."""
        helper, numpy_helper = self.helper, _package("onnx.numpy_helper")
        unit = "mm, in the frame of the reference instrument; of several sessions, in that of the first"
        outputs = [helper.make_tensor_value_info(output, 11, ("n", 3), doc_string=unit)]
        constants = [numpy_helper.from_array(array, name) for name, array in self.constants.items()]
        graph = helper.make_graph(self.nodes, "truearm", self.inputs, outputs, constants)
        file = helper.make_model(
            graph,
            opset_imports=[helper.make_opsetid("", OPSET)],
            ir_version=IR_VERSION,
            producer_name="truearm",
            producer_version=__version__,
            doc_string=f"Coordinates of the tip of {model.arm_.name} [mm] from its joint angles "
            f"[rad, or mm of sliding joints]: {manifest.provenance.model} model, double precision.",
        )
        helper.set_model_props(file, {MARKER: manifest.line().partition(": ")[2]})
        _package("onnx.checker").check_model(file, full_check=True)
        content: bytes = file.SerializeToString(deterministic=True)
        return content

    def _constant(self, array: npt.NDArray[Any]) -> str:
        name = f"constant.{len(self.constants)}"
        self.constants[name] = array
        return name


class _ChainGraph:
    """The chain with its motions: builds the nodes from the tip to the base."""

    def __init__(self, graph: _Graph, plain: PlainModel) -> None:
        self.graph = graph
        self.plain = plain
        self.chain = plain.chain
        self.q = [graph.rows(graph.joints, [i]) for i in range(plain.n_joints)]
        turning = np.flatnonzero(~plain.chain.is_prismatic).tolist()
        self.cos = {i: graph.node("Cos", self.q[i]) for i in turning}
        self.sin = {i: graph.node("Sin", self.q[i]) for i in turning}
        pairs = {function.harmonic for function in plain.functions} - {None}
        self.orders = {
            joint: sorted(pair[1] for pair in pairs if pair and pair[0] == joint)
            for joint in range(1, plain.n_joints + 1)
        }
        self.harmonics = {joint: self._harmonics(joint, orders) for joint, orders in self.orders.items() if orders}
        self.torques = self._torques()
        self.states = self._states()
        self.formulas: dict[Expression, str] = {}

    def tip(self) -> str:
        """(3, n) tips."""
        graph, chain = self.graph, self._with_constant_motions()
        v = graph.constant(chain.tip_in_flange[:, None])
        if (motion := self._motion(chain.n_places - 1)) is not None:
            v = graph.sum(v, graph.rows(motion, (3, 4, 5)))
        R, t = chain.fixed[-1, :3, :3], chain.fixed[-1, :3, 3]
        v = graph.affine(R, v, t)
        for place in range(chain.n_joints, 0, -1):
            v = self._moved(v, place)
            joint = place - 1
            R, t = chain.fixed[joint, :3, :3], chain.fixed[joint, :3, 3]
            if joint == 0 and self._blocks(0):  # the base moves between joint 1 and F0
                v = self._moved(self._through_joint(v, 0, np.eye(3), np.zeros(3)), 0)
                return graph.affine(R, v, t)
            v = self._through_joint(v, joint, R, t)
        return v

    def _with_constant_motions(self) -> Chain:
        """The chain with the motions of the places where all functions are constant."""
        constant = [np.zeros(6) if self._blocks(i) else self._offset(i) for i in range(self.chain.n_places)]
        constant[-1][:3] = 0.0  # a rotation at the tip does not move it
        return self.chain.with_motions(constant)

    def _through_joint(self, v: str, joint: int, R: FloatArray, t: FloatArray) -> str:
        """``R J(q) v + t``: vectors from behind a joint (counted from 0) to before the fixed motion that it ends."""
        graph = self.graph
        if self.chain.is_prismatic[joint]:
            shift = graph.product(graph.constant(R[:, 2:3]), self.q[joint])
            return graph.sum(graph.affine(R, v, t), shift)
        stacked = np.concatenate([R @ ALONG, R @ ACROSS, R @ AXIS])
        along, across, axis = graph.split(graph.affine(stacked, v, np.concatenate([np.zeros(6), t])), 3)
        return self._turned(joint, along, across, axis)

    def _turned(self, joint: int, along: str, across: str, axis: str) -> str:
        graph = self.graph
        return graph.sum(graph.product(along, self.cos[joint]), graph.product(across, self.sin[joint]), axis)

    def _moved(self, v: str, place: int) -> str:
        """Vectors after the motion of a place, by Rodrigues' formula."""
        graph, motion = self.graph, self._motion(place)
        if motion is None:
            return v
        t = graph.rows(motion, (3, 4, 5))
        if not self.plain.motion_by_function[self.plain.place == place, :3].any():
            return graph.sum(v, t)
        r = graph.rows(motion, (0, 1, 2))
        square = graph.node("MatMul", graph.constant(np.ones((1, 3))), graph.product(r, r))
        angle = graph.node("Sqrt", graph.sum(square, graph.constant([[TINY]])))
        half = graph.product(angle, graph.constant([[0.5]]))
        sinc, sinc_half = (graph.node("Div", graph.node("Sin", a), a) for a in (angle, half))
        rv = graph.cross(r, v)
        # (1 - cos a) / a^2 = (sin(a/2) / (a/2))^2 / 2 without cancellation
        second = graph.product(graph.product(sinc_half, sinc_half), graph.constant([[0.5]]))
        return graph.sum(v, graph.product(sinc, rv), graph.product(second, graph.cross(r, rv)), t)

    def _motion(self, place: int) -> str | None:
        """(6, n) motion of a place [rad, mm]; None where none depends on the reading."""
        graph, blocks, offset = self.graph, self._blocks(place), self._offset(place)
        if not blocks:
            return None
        # A state may have one column for all poses; what follows from the joints has one for each.
        narrow = {*self.states.values(), *(node for one, node in self.formulas.items() if not _is_of_joints(one))}
        wide = [name for name in blocks if name not in narrow]
        parts = [graph.node("MatMul", graph.constant(blocks[name]), name) for name in blocks if name not in wide]
        if wide:
            values = wide[0] if len(wide) == 1 else graph.node("Concat", *wide, axis=0)
            parts.append(graph.affine(np.concatenate([blocks[name] for name in wide], axis=1), values, offset))
        else:
            parts.append(graph.constant(offset[:, None]))
        return graph.sum(*parts)

    def _blocks(self, place: int) -> dict[str, FloatArray]:
        """By node with functions of the reading (n_rows, n), the motion by each of its rows (6, n_rows)."""
        blocks: dict[str, FloatArray] = {}
        for row in np.flatnonzero(self.plain.place == place).tolist():
            function = self.plain.functions[row]
            if function != ONE:
                name, at, n_rows = self._function_row(function)
                blocks.setdefault(name, np.zeros((6, n_rows)))[:, at] += self.plain.motion_by_function[row]
        return blocks

    def _offset(self, place: int) -> FloatArray:
        """(6,) constant part of the motion of a place."""
        constant = np.array([function == ONE for function in self.plain.functions], dtype=bool)
        return np.asarray(self.plain.motion_by_function[constant & (self.plain.place == place)].sum(axis=0))

    def _function_row(self, function: Expression) -> tuple[str, int, int]:
        """The node that has a function, its row there, and the number of rows."""
        of = function.arguments
        if (pair := function.harmonic) is not None:
            orders = self.orders[pair[0]]
            at = orders.index(pair[1]) + (len(orders) if function.operation == "sin" else 0)
            return self.harmonics[pair[0]], at, 2 * len(orders)
        match function.operation:
            case "gravity torque":
                return self.torques[of[0]], of[1], 3
            case "direction":
                return self.states["directions"], of[0] - 1, self.plain.n_joints
            case "column":
                return self.states[of[0]], 0, 1
            case "temperature":
                return self.states["temperature_degC"], 0, 1
        if function not in self.formulas:
            self.formulas[function] = self._formula(function)
        return self.formulas[function], 0, 1

    def _formula(self, expression: Expression) -> str:
        """(1, n) values of an expression."""
        graph, of = self.graph, expression.arguments
        parts = [self._formula(one) for one in of if isinstance(one, Expression)]
        match expression.operation:
            case "number":
                return graph.constant([[of[0]]])
            case "angle":
                return self.q[int(of[0]) - 1]
            case "sum":
                return graph.sum(*parts)
            case "product":
                return reduce(graph.product, parts)
            case "power":
                return reduce(graph.product, parts * int(of[1]))
            case "cos" | "sin":
                return graph.node(expression.operation.capitalize(), parts[0])
        name, at, n_rows = self._function_row(expression)
        return name if n_rows == 1 else graph.rows(name, [at])

    def _harmonics(self, joint: int, orders: list[int]) -> str:
        """(2 n_orders, n) cosines, then sines."""
        graph = self.graph
        angle = graph.product(graph.constant(np.array(orders, dtype=float)[:, None]), self.q[joint - 1])
        return graph.node("Concat", graph.node("Cos", angle), graph.node("Sin", angle), axis=0)

    def _states(self) -> dict[str, str]:
        """Nodes of what a reading may state, one row a quantity: temperature above 20 degC, directions, columns."""
        graph, training, nodes = self.graph, self.plain.model.training_, {}
        if self.plain.uses("temperature"):
            assert training.temperature_degC is not None  # the terms were identified with it
            mean = np.array([training.temperature_degC.mean])
            name = graph.input("temperature_degC", [None], "degC; by default the mean of the training", mean)
            nodes[name] = graph.row(graph.node("Sub", name, graph.constant([REFERENCE_DEGC])))
        if self.plain.uses("direction"):
            doc = "-1 or 1, the sign of each joint's last movement, 0 where it is unknown; by default 0"
            name = graph.input("directions", (None, self.plain.n_joints), doc, np.zeros((1, self.plain.n_joints)))
            nodes[name] = graph.node("Transpose", name, perm=[1, 0])
        for column in self.plain.columns():
            mean = np.array([training.columns[column].mean])
            name = graph.input(column, [None], "in the unit of its name; by default the mean of the training", mean)
            nodes[name] = graph.row(name)
        return nodes

    def _torques(self) -> dict[int, str]:
        """(3, n) gravity torques [N m] at the nominal pose, by joint; 0 is the base. As `gravity_loads` has them."""
        graph, plain, chain = self.graph, self.plain, self.plain.nominal_chain
        used = {one.arguments[0] for one in plain.inputs if one.operation == "gravity torque"}
        if not used:
            return {}
        n = chain.n_joints
        along = graph.constant((chain.fixed[0, :3, :3].T @ plain.gravity_in_base)[:, None])
        gravity = []
        for i in range(n):
            R = np.eye(3) if i == 0 else chain.fixed[i, :3, :3].T
            if chain.is_prismatic[i]:
                along = graph.affine(R, along, np.zeros(3))
            else:
                stacked = np.concatenate([ALONG @ R, -ACROSS @ R, AXIS @ R])
                along = self._turned(i, *graph.split(graph.affine(stacked, along, np.zeros(9)), 3))
            gravity.append(along)
        torques, vectors, mass = {}, link_vectors(chain), 0.0
        moment = graph.constant(np.zeros((3, 1)))  # [kg mm]
        for i in reversed(range(n)):
            local = mass * vectors[i + 1] + plain.mass_kg[i] * plain.centre_in_joint_mm[i]
            moment = graph.sum(moment, graph.constant(local[:, None]))
            mass += float(plain.mass_kg[i])
            if used & ({0, 1} if i == 0 else {i + 1}):
                scaled = graph.product(moment, graph.constant([[1e-3]]))  # mm to m
                torques[i + 1] = graph.cross(scaled, gravity[i])
            if chain.is_prismatic[i]:
                shift = graph.product(graph.constant([[0.0], [0.0], [mass]]), self.q[i])
                moment = graph.affine(chain.fixed[i, :3, :3], graph.sum(moment, shift), np.zeros(3))
            else:
                moment = self._through_joint(moment, i, chain.fixed[i, :3, :3], np.zeros(3))
        if 0 in used:
            torques[0] = self._through_joint(torques[1], 0, np.eye(3), np.zeros(3))
            if chain.is_prismatic[0]:
                torques[0] = torques[1]
        return torques


def _of_mean(model: Compensator) -> Compensator:
    """The model without terms that are only uncertain: their coefficients are zero, and points do not need them."""
    new = copy.copy(model)
    if isinstance(new, IdentifiedModel):
        x, chain = new.fit_.coefficients, new.fit_.perturbed_chain
        moving = {term for term, columns in zip(chain.terms, chain.columns, strict=True) if x[columns].any()}
        new.fit_ = new.fit_.select(moving.__contains__)
    return new


def _is_of_joints(expression: Expression) -> bool:
    return any(one.operation in ("angle", "gravity torque") for one in expression.inputs)


def _network_tip(graph: _Graph, model: NetworkModel) -> str:
    """(3, n) mean of the members' points."""
    angle, point = model.angle_scale_, model.point_scale_
    is_read = model.arm_.chain.is_read
    joints = graph.joints if is_read.all() else graph.rows(graph.joints, np.flatnonzero(is_read).tolist())
    shifted = graph.node("Sub", joints, graph.constant((angle.lower + angle.half_range)[:, None]))
    inputs = graph.node("Div", shifted, graph.constant(angle.half_range[:, None]))
    members = []
    for member in model.members_:
        value = inputs
        for W, activation in zip(
            model.network_.layers(member.weights), (*model.network_.hidden, "purelin"), strict=True
        ):
            value = _activated(graph, graph.affine(W[:-1].T, value, W[-1]), activation)
        members.append(value)
    mean = graph.product(graph.sum(*members), graph.constant([[1 / len(members)]]))
    scaled = graph.product(mean, graph.constant(point.half_range[:, None]))
    return graph.sum(scaled, graph.constant((point.lower + point.half_range)[:, None]))


def _activated(graph: _Graph, net: str, activation: str) -> str:
    if activation == "purelin":
        return net
    if activation == "tansig":
        return graph.node("Tanh", net)
    half = graph.constant([[0.5]])  # logsig through tanh, as Activation has it
    return graph.sum(graph.product(graph.node("Tanh", graph.product(net, half)), half), half)
