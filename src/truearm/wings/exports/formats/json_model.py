"""A fitted model as one JSON document: for programs that read it without truearm. See `json_document`."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from pydantic import ValidationError

from truearm.arm import Chain, drawn_table
from truearm.arm.nearest_table import drawn_convention
from truearm.errors import InputError
from truearm.files.atomic_write import atomic_file
from truearm.files.file_reading import read_limited
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.terms import (
    ArmState,
    Basis,
    Expression,
    Formula,
    LinkMasses,
    PayloadTorque,
    Term,
    uniform_links,
)
from truearm.identification.terms.basis import check_parts
from truearm.models import Compensator, IdentifiedModel, NetworkModel
from truearm.models.model_archive import readable_json
from truearm.nets.perceptron import MinMaxScaler, Perceptron
from truearm.readings.readings import PAYLOAD
from truearm.typing import FloatArray
from truearm.wings.exports.formats import json_document as form
from truearm.wings.exports.formats.plain_model import expressions_of, loaded_links
from truearm.wings.exports.targets.manifest import MARKER, Manifest, check_not_coupled, read_manifest, stated_text

# The physical model of a robot, 1,400 coefficients, has 10 MB; the manifest is read from files of up to this size.
MAX_BYTES = 64 * 2**20


def write(model: Compensator, manifest: Manifest, path: str | Path) -> None:
    """Write a fitted model as JSON.

    Parameters
    ----------
    model : Compensator
        Fitted.
    manifest : Manifest
        The first key of the document.
    path : path

    Raises
    ------
    InputError
        If a term has a basis without expressions, or the model is larger than `MAX_BYTES`.
    """
    document = document_of(model, manifest).model_dump(mode="json", by_alias=True)
    parts = [f" {json.dumps(key)}: {readable_json(value, 2)}" for key, value in document.items() if key != MARKER]
    first = f' "{MARKER}": {manifest.line().partition(": ")[2]}'  # on one line, as in any other format
    content = ("{\n" + ",\n".join([first, *parts]) + "\n}\n").encode()
    if len(content) > MAX_BYTES:
        raise InputError(
            f"the model has {len(content) / 1e6:.0f} MB as JSON, and {MAX_BYTES / 1e6:.0f} MB is the limit",
            hint="keep it as a model file, or fit a model with fewer terms or units",
        )
    with atomic_file(path, read=read_manifest) as temporary:
        temporary.write_bytes(content)


def tips(path: str | Path, joints: npt.ArrayLike) -> FloatArray:
    """Evaluate a written file.

    Parameters
    ----------
    path : path
    joints : (n, n_joints) array
        [rad, or mm].

    Returns
    -------
    (n, 3) array
        [mm], with the temperatures and columns of the training.

    Raises
    ------
    InputError
        If the file is no such document, or its numbers do not fit each other.
    """
    document = read(path)
    with InputError.of_file(path):
        return _tips(document, np.asarray(joints, dtype=float))


def read(path: str | Path) -> form.ModelDocument:
    """The document in a file, checked against its form.

    Raises
    ------
    InputError
        If the file is missing or too large, is not JSON, or breaks the form.
    """
    content = read_limited(path, limit_bytes=MAX_BYTES)
    try:
        return form.ModelDocument.model_validate_json(content)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "as a whole"
        raise InputError(f"{where}: {first['msg']}", file=path) from None


def document_of(model: Compensator, manifest: Manifest) -> form.ModelDocument:
    """The document of a fitted model. Errors as in `write`."""
    if not isinstance(model, NetworkModel | IdentifiedModel):
        raise InputError(
            f"expected a nominal, kinematic, physical or network model, got a {type(model).__name__}",
            hint="export the kinematic or physical model of the same readings",
        )
    check_not_coupled(model.arm_, "json")
    network = _network_of(model) if isinstance(model, NetworkModel) else None
    return form.ModelDocument(
        **{MARKER: manifest},  # the key of the document is no name of Python
        format="truearm-model",
        version=2,
        units=form.Units(),
        model=cast(Any, manifest.provenance.model),
        arm=_arm_of(model),
        reference_chain=_chain_of(model.nominal_.chain),
        identified=_identified_of(model) if isinstance(model, IdentifiedModel) else None,
        network=network,
        session_frames={name: T.tolist() for name, T in model.session_frames_.items()},
        training=_training_of(model),
    )


# From the model ------------------------------------------------------------------------------------------------------


def _arm_of(model: NetworkModel | IdentifiedModel) -> form.Arm:
    arm, state = model.arm_, ArmState.of(model.arm_, model.arm_.working[None])
    links = uniform_links(state.chain, kg_per_m=1.0) if state.links is None else state.links
    if isinstance(model, IdentifiedModel):
        links = loaded_links(model)
    kinds = np.where(arm.chain.is_prismatic, "prismatic", "revolute").tolist()
    joints = [
        form.Joint(name=name, kind=kind, lower=_finite(lower), upper=_finite(upper), working=float(at))
        for name, kind, (lower, upper), at in zip(arm.joint_names, kinds, arm.limits, arm.working, strict=True)
    ]
    return form.Arm.of(
        links,
        **{name: stated_text(getattr(arm, name)) for name in ("name", "title", "serial_number", "source")},
        joints=joints,
        chain=_chain_of(arm.chain),
        denavit_hartenberg=_table_of(arm.chain),
        masses_are_known=arm.masses is not None,
        gravity_in_base_m_s2=state.gravity_in_base,
    )


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _chain_of(chain: Chain) -> form.Chain:
    return form.Chain.of(chain, tip_in_flange_mm=chain.tip_in_flange)


def _table_of(chain: Chain) -> form.DenavitHartenberg | None:
    try:
        table = drawn_table(chain, drawn_convention(chain))
    except InputError:  # frames that no row describes
        return None
    with_unit = {"a_mm": table.a, "d_mm": table.d, "alpha_rad": table.alpha, "theta_rad": table.theta}
    with_unit |= {"beta_rad": table.beta, "b_mm": table.b, "tip_mm": table.tip_in_flange}
    return form.DenavitHartenberg.of(table, **with_unit)


def _identified_of(model: IdentifiedModel) -> form.Identified:
    fit, terms, uncertain = model.fit_, [], []
    chain = fit.perturbed_chain
    # Zero at the payload of the training.
    pairs = [
        pair for pair in zip(chain.terms, chain.columns, strict=True) if not isinstance(pair[0].basis, PayloadTorque)
    ]
    pairs.sort(key=lambda pair: not fit.coefficients[pair[1]].any())
    bases: list[Basis] = []
    uncertainties = np.sqrt(np.maximum(fit.covariance.diagonal(), 0.0))
    for term, rows in pairs:
        bases.append(term.basis if isinstance(term.basis, form.NAMED) else _formula_of(term))
        if not fit.coefficients[rows].any():
            uncertain.append(form.UncertainTerm.of(term, basis=bases[-1].as_data()))
            continue
        terms.append(
            form.Term.of(
                term,
                basis=bases[-1].as_data(),
                functions=[_label(one) for one in term.basis.labels()],
                coefficients=fit.coefficients[rows],
                standard_uncertainties=uncertainties[rows],
                prior_standard_deviations=fit.prior_std[rows],
                prior_is_scaled_by_evidence=term.learn,
            )
        )
    kept = np.concatenate([np.zeros(0, np.intp), *(rows for _, rows in pairs)])
    check_parts(bases)
    beyond = model.variance_function_.beyond
    return form.Identified(
        chain=_chain_of(fit.perturbed_chain.chain),
        terms=terms,
        uncertain_terms=uncertain,
        covariance=form.symmetric_matrix(fit.covariance[np.ix_(kept, kept)]),
        residual_standard_deviation_mm=model.residual_std_,
        variance_function=form.VarianceFunction.of(
            model.variance_function_, beyond=None if beyond is None else form.Extrapolation.of(beyond)
        ),
        birge_ratio=model.birge_ratio_,
        skipped_terms={skipped.name: skipped.reason for skipped in model.excluded_terms_},
    )


def _label(text: str) -> str:
    """Name of a function, cut where a formula in words is longer than the form allows."""
    return text if len(text) <= form.LONGEST_TEXT else f"{text[: form.LONGEST_TEXT - 3]}..."


def _formula_of(term: Term) -> Formula:
    return Formula(tuple(one.with_inputs({"payload torque": 0.0}) for one in expressions_of(term.basis)))


def _network_of(model: NetworkModel) -> form.Network:
    members = [
        form.Member(
            layers=[layer.tolist() for layer in model.network_.layers(member.weights)],
            basis_covariance=form.symmetric_matrix(member.basis_covariance),
        )
        for member in model.members_
    ]
    return form.Network(
        activations=cast(Any, [*model.network_.hidden, "purelin"]),
        joint_range=form.Range.of(model.angle_scale_),
        point_range_mm=form.Range.of(model.point_scale_),
        members=members,
        residual_covariance_mm2=model.residual_covariance_.tolist(),
    )


def _training_of(model: Compensator) -> form.Training:
    training, stated = model.training_, form.StatedInput.of
    return form.Training.of(
        training,
        joint_ranges=training.angle_ranges,
        joint_gaps=[
            form.Gap(joint=int(joint) + 1, lower=lower, upper=upper) for joint, lower, upper in training.angle_gaps
        ],
        temperature_degC=None if training.temperature_degC is None else stated(training.temperature_degC),
        columns={name: stated(values) for name, values in training.columns.items()},
        free_parts=model.free_,
        readings_sha256=training.fingerprint,
    )


# From the document ---------------------------------------------------------------------------------------------------


def _tips(document: form.ModelDocument, joints: FloatArray) -> FloatArray:
    """(n, 3) tips [mm] at joints (n, n_joints) by a document whose form is right."""
    n_joints = len(document.arm.joints)
    if joints.ndim != 2 or joints.shape[1] != n_joints or not np.isfinite(joints).all():
        raise InputError(f"expected finite joints of shape (n, {n_joints}), got shape {joints.shape}")
    with np.errstate(all="ignore"):  # of numbers so large that they overflow
        if document.network is not None:
            out = _network_tips(document.network, joints)
        else:
            assert document.identified is not None  # the form has one of the two
            out = _identified_tips(document, document.identified, joints)
    if not np.isfinite(out).all():
        raise InputError("the model in the file does not predict finite points")
    return out


def _identified_tips(document: form.ModelDocument, identified: form.Identified, joints: FloatArray) -> FloatArray:
    chain = _chain(document, identified.chain)
    terms, coefficients = [], []
    for data in (*identified.terms, *identified.uncertain_terms):
        term = _at_payload(_term(data), document.training)
        term.check_place(chain)
        own = data.coefficients if isinstance(data, form.Term) else [0.0] * term.n_coefficients
        if len(own) != term.n_coefficients:
            raise InputError(f"term {term.name!r}: expected {term.n_coefficients} coefficients")
        terms.append(term)
        coefficients.extend(own)
    check_parts(term.basis for term in terms)
    if len(coefficients) > form.MAX_COEFFICIENTS or identified.covariance.size != len(coefficients):
        raise InputError(
            f"expected a covariance of all {len(coefficients)} coefficients, at most {form.MAX_COEFFICIENTS}, got one "
            f"of {identified.covariance.size}"
        )
    return PerturbedChain(chain, tuple(terms)).tips(_state(document, joints), np.array(coefficients))


def _term(data: form.UncertainTerm) -> Term:
    prior: dict[str, Any] = {"group": data.name, "prior_std": 1.0, "learn": False}
    if isinstance(data, form.Term):
        prior = {"group": data.group, "prior_std": data.prior_standard_deviations}
        prior["learn"] = data.prior_is_scaled_by_evidence
    return Term.from_data(prior | data.model_dump(include={"name", "place", "direction", "basis"}))


def _at_payload(term: Term, training: form.Training) -> Term:
    """A term with the payload of the training for its column: the masses of the document contain it already."""
    if PAYLOAD not in training.columns or "column" not in (term.basis.inputs or ()):
        return term
    column, kg = Expression.column(PAYLOAD), training.columns[PAYLOAD].mean
    expressions = expressions_of(term.basis)
    if not any(column in one.inputs for one in expressions):
        return term
    return replace(term, basis=Formula(tuple(one.with_inputs({column: kg}) for one in expressions)))


def _state(document: form.ModelDocument, joints: FloatArray) -> ArmState:
    """State of the arm at joints, with the means of the training."""
    arm, training, n = document.arm, document.training, len(joints)
    return ArmState(
        _chain(document, arm.chain),
        joints,
        temperature_degC=None if training.temperature_degC is None else np.full(n, training.temperature_degC.mean),
        directions=np.zeros_like(joints),
        columns={name: np.full(n, stated.mean) for name, stated in training.columns.items() if name != PAYLOAD},
        links=LinkMasses(np.array(arm.mass_kg), np.array(arm.centre_in_joint_mm, dtype=float).reshape(-1, 3)),
        gravity_in_base=np.array(arm.gravity_in_base_m_s2),
    )


def _chain(document: form.ModelDocument, chain: form.Chain) -> Chain:
    prismatic = np.array([joint.kind == "prismatic" for joint in document.arm.joints])
    return Chain(np.array(chain.fixed), np.array(chain.tip_in_flange_mm), prismatic)


def _network_tips(network: form.Network, joints: FloatArray) -> FloatArray:
    scales = []
    for what, size in ((network.joint_range, joints.shape[1]), (network.point_range_mm, 3)):
        scale = MinMaxScaler(np.array(what.lower), np.array(what.upper))
        if scale.lower.shape != (size,) or scale.upper.shape != (size,) or not (scale.lower < scale.upper).all():
            raise InputError(f"expected rising ranges of {size} quantities of the network")
        scales.append(scale)
    hidden = [len(layer[0]) if layer else 0 for layer in network.members[0].layers[:-1]]
    perceptron = Perceptron((joints.shape[1], *hidden, 3), tuple(network.activations[:-1]))
    inputs, points = scales[0].scale(joints.T), []
    for member in network.members:
        layers = member.layers
        shapes = [(len(layer), *{len(row) for row in layer}) for layer in layers]
        if shapes != list(perceptron.shapes) or network.activations[-1:] != ["purelin"]:
            raise InputError(f"expected layers of weights of the shapes {list(perceptron.shapes)}, got {shapes}")
        outputs = perceptron.through([np.array(layer) for layer in layers], inputs)[-1]
        points.append(scales[1].unscale(outputs).T)
    return np.asarray(np.mean(points, axis=0))
