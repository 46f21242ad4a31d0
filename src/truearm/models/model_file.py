"""The kinds of models, and a model read from its file, with checks that its arrays and numbers fit each other."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.identification.estimation.identification_result import IdentificationResult
from truearm.identification.estimation.residual_process import GROUP
from truearm.identification.judgement.tails import LEAST_FREEDOM
from truearm.identification.references.session_frames import checked_frames
from truearm.identification.terms import ArmState, Term
from truearm.identification.terms.basis import check_parts
from truearm.identification.terms.kernel import InducedProcess
from truearm.models.compensator import FREE_PARTS, Compensator
from truearm.models.hybrid import HybridModel
from truearm.models.identified_model import IdentifiedModel, KinematicModel, NominalModel, PhysicalModel
from truearm.models.model_archive import Array, Header, decode_learned, read_archive
from truearm.models.network import NetworkModel
from truearm.nets.perceptron import MinMaxScaler
from truearm.solve.linear_algebra import add_to_diagonal, cholesky_solver, unit_diagonal
from truearm.solve.threads import one_blas_thread
from truearm.typing import FloatArray

# Of a covariance scaled to a unit diagonal, beyond rounding.
MAX_ASYMMETRY = 1e-6
LEAST_EIGENVALUE = -1e-6
# Rows that are compared with their columns at once: the cache holds them.
BLOCK_ROWS = 128

MODELS: dict[str, type[Compensator]] = {
    kind.kind: kind for kind in (NominalModel, KinematicModel, PhysicalModel, NetworkModel, HybridModel)
}


@one_blas_thread()
def load_model(path: str | Path) -> Compensator:
    """Read a model file.

    Returns
    -------
    Compensator
        Fitted; it predicts the same numbers to the last bit.

    Raises
    ------
    InputError
        If the file is missing, too large, damaged, not a model file, or of another format.

    Examples
    --------
    >>> import truearm as ta
    >>> session = ta.simulate("ur10", poses=20).session
    >>> ta.fit("ur10", session, model="nominal").save("arm.truearm")
    >>> ta.load_model("arm.truearm").n_train_
    20
    """
    try:
        return _build(*read_archive(path))
    except InputError as error:
        raise error.in_file(Path(path)) from None
    except (LookupError, ValueError, TypeError, ArithmeticError) as error:
        raise InputError(f"model.json does not describe a model of its kind ({error})", file=path) from None


def _build(header: Header, arrays: dict[str, Array]) -> Compensator:
    kind = MODELS[header.model]
    learned = decode_learned(kind, header, arrays)
    options = {name: tuple(value) if isinstance(value, list) else value for name, value in header.options.items()}
    if "terms" in options:
        options["terms"] = tuple(map(Term.from_data, options["terms"]))
    model = kind(learned["arm_"], **options)
    model._check_options()
    for name, value in learned.items():
        setattr(model, name, value)
    model.n_features_in_ = model.arm_.n_joints
    check_model(model)
    return model


Compensator._load = staticmethod(load_model)


def check_model(model: Compensator) -> None:
    """Refuse a model whose parts do not fit each other, or that does not predict finite numbers."""
    training, n_joints = model.training_, model.arm_.n_joints
    _check_shape("training_.angle_ranges", training.angle_ranges, (n_joints, 2))
    if not set(model.free_) <= set(FREE_PARTS) or model.fit_seconds_ < 0:
        raise InputError(f"expected free parts among {list(FREE_PARTS)} and a duration of the fit of 0 s or more")
    if frames := model.session_frames_:
        model.session_frames_ = checked_frames(list(frames), np.stack(list(frames.values())))
    _check_identification("nominal_", model.nominal_, n_joints)
    if isinstance(model, IdentifiedModel | HybridModel):
        _check_identification("fit_", model.fit_, n_joints)
        _check_shape("variance_function_.centre", model.variance_function_.centre, (n_joints,))
        if (beyond := model.variance_function_.beyond) is not None:
            _check_shape("variance_function_.beyond.ranges", beyond.ranges, (n_joints, 2))
        if not 0 <= model.residual_std_ < np.inf:
            raise InputError("expected a residual standard deviation of 0 or more")
        if not model.tail_freedom_ >= LEAST_FREEDOM:
            raise InputError(f"expected {LEAST_FREEDOM:g} or more degrees of freedom of the tails")
    if isinstance(model, IdentifiedModel):
        if not 1 <= model.birge_ratio_ < np.inf:
            raise InputError("expected a Birge ratio of 1 or more")
        if not 0 <= model.repeating_share_ <= 1:
            raise InputError("expected a share of 0 to 1 of the residual variance that repeats at the same pose")
        if model.hysteresis_.size:
            _check_shape("hysteresis_", model.hysteresis_, (2, n_joints))
        _check_process(model, n_joints)
        _check_shape("refit_reading_ids_", model.refit_reading_ids_, (len(model.refit_reading_ids_),))
    if isinstance(model, NetworkModel):
        _check_network(model)
    if isinstance(model, HybridModel):
        _check_hybrid(model, n_joints)
    one = model.with_tip(model.tips_[0]) if len(model.tips_) > 1 else model
    with np.errstate(all="ignore"):
        points, covariance = one.predict(model.arm_.working[None], return_cov=True)
        # Constants alone: its state has no temperature or load.
        nominal = one.nominal_.tips(ArmState.of(model.arm_, model.arm_.working[None]))
    if not all(np.isfinite(numbers).all() for numbers in (nominal, points, covariance)):
        raise InputError("the model does not predict finite numbers at the arm's working pose")


def _check_identification(name: str, fit: IdentificationResult, n_joints: int) -> None:
    chain, n = fit.perturbed_chain.chain, fit.perturbed_chain.n_coefficients
    if chain.n_joints != n_joints:
        raise InputError(f"expected a chain of {n_joints} joints of {name}, got {chain.n_joints}")
    check_parts(term.basis for term in fit.perturbed_chain.terms)
    for term in fit.perturbed_chain.terms:
        term.check_place(chain)
        if isinstance(term.basis, InducedProcess):
            slides = tuple((np.flatnonzero(chain.is_prismatic) + 1).tolist())
            if len(term.basis.length_scales) != n_joints or term.basis.sliding != slides:
                raise InputError(f"expected a process over {n_joints} joints of {name}, of which {slides} slide")
    _check_shape(f"{name}.coefficients", fit.coefficients, (n,))
    _check_shape(f"{name}.prior_std", fit.prior_std, (n,))
    _check_covariance(f"{name}.covariance", fit.covariance, n)
    if fit.repeatability_covariance is not None:
        _check_covariance(f"{name}.repeatability_covariance", fit.repeatability_covariance, n)
    if not (fit.prior_std > 0).all() or not fit.references:
        raise InputError(f"expected prior standard deviations above zero and a reference of {name}")
    if any(not (min(g.effective, g.scale) >= 0 and max(g.effective, g.scale) < np.inf) for g in fit.groups):
        raise InputError(f"expected numbers of 0 or more of the groups of {name}")
    for i, reference in enumerate(fit.references):
        m, shape = len(reference.rows), reference.residuals.shape
        for part, expected in (
            ("rows", (m,)),
            ("residuals", (*shape[:1], m)),
            ("std", shape),
            ("robust_weight", (m,)),
            ("artefact", (m,)),
        ):
            _check_shape(f"{name}.references.{i}.{part}", getattr(reference, part), expected)
        if (of_repeats := reference.repeat_variance) is not None:
            _check_shape(f"{name}.references.{i}.repeat_variance", of_repeats, (m,))
            if (of_repeats < 0).any():
                raise InputError(f"expected variances of repeats of 0 or more in {name}")
        weight = reference.robust_weight
        if not ((weight >= 0) & (weight <= 1)).all() or (reference.std < 0).any():
            raise InputError(f"expected robust weights from 0 to 1 and uncertainties of 0 or more in {name}")
        if not 0 <= reference.noise_std < np.inf or not np.isfinite(list(reference.unknowns.values())).all():
            raise InputError(f"expected a noise of 0 or more and finite unknowns of the references of {name}")


def _check_process(model: IdentifiedModel, n_joints: int) -> None:
    """Refuse a record of a residual process that is not that of the terms."""
    terms = [term for term in model.fit_.perturbed_chain.terms if term.group == GROUP]
    process = model.residual_process_
    if process is not None:
        process.check(n_joints)
    if bool(terms) != (process is not None and process.is_kept):
        raise InputError("expected terms of the residual process where the model says that it is kept, and only there")
    if not terms or process is None:
        return
    basis = terms[0].basis
    if not isinstance(basis, InducedProcess) or any(term.basis != basis for term in terms):
        raise InputError("expected terms of a residual process with the same inducing points")
    if (basis.n_functions, basis.length_scales) != (process.n_points, process.length_scales):
        raise InputError("expected the inducing points and length scales of the residual process that its terms have")


def _check_network(model: NetworkModel) -> None:
    n_inputs = int(model.arm_.chain.is_read.sum())
    if not model.members_ or model.network_.sizes != (n_inputs, *model.hidden, 3):
        raise InputError("expected a network of the layers that the options state, and one member or more")
    units = model.network_.sizes[-2] + 1
    _check_covariance("residual_covariance_", model.residual_covariance_, 3)
    for name, k in (("angle_scale_", n_inputs), ("point_scale_", 3)):
        _check_scale(name, getattr(model, name), k)
    for i, member in enumerate(model.members_):
        _check_shape(f"members_.{i}.weights", member.weights, (model.network_.n_weights,))
        _check_covariance(f"members_.{i}.basis_covariance", member.basis_covariance, units)
        record = member.record
        columns = [one.name for one in fields(record) if one.name not in ("best_epoch", "stop")]
        for column in columns:
            _check_shape(f"members_.{i}.record.{column}", getattr(record, column), (len(record.perf),))
        if member.start < 0 or not 0 <= record.best_epoch < len(record.perf):
            raise InputError(f"expected a start and a best epoch of member {i} that there were")


def _check_hybrid(model: HybridModel, n_joints: int) -> None:
    inputs, committee = model.inputs_, model.committee_
    if not np.array_equal(inputs.is_prismatic, model.arm_.chain.is_prismatic):
        raise InputError("expected inputs of the joints of the arm")
    n_candidates = 2 * n_joints - int(inputs.is_prismatic.sum()) + 1
    if not 0 < inputs.n_inputs <= n_candidates or not (np.diff(inputs.kept) > 0).all():
        raise InputError("expected inputs of a network that are numbered upwards")
    if inputs.kept[-1] >= n_candidates or committee.network.sizes != (inputs.n_inputs, *model.hidden, 3):
        raise InputError("expected networks of the inputs that there are and of the layers that the options state")
    if inputs.has_temperature and model.training_.temperature_degC is None:
        raise InputError("expected the temperatures of the training, which are an input of the networks")
    _check_scale("inputs_.scale", inputs.scale, inputs.n_inputs)
    k = len(committee.weights)
    if k < 2:
        raise InputError("expected two networks or more")
    _check_shape("committee_.weights", committee.weights, (k, committee.network.n_weights))
    for name, values in (("effective", committee.effective), ("epochs", committee.epochs)):
        _check_shape(f"committee_.{name}", values, (k,))
    if not 0 < model.target_scale_mm_ < np.inf:
        raise InputError("expected a scale above zero of the networks' outputs")


def _check_scale(name: str, scale: MinMaxScaler, k: int) -> None:
    _check_shape(f"{name}.lower", scale.lower, (k,))
    _check_shape(f"{name}.upper", scale.upper, (k,))
    if not (np.isfinite(scale.lower) & np.isfinite(scale.upper) & (scale.lower < scale.upper)).all():
        raise InputError(f"expected ranges of {name} that rise from lower to upper")


def _check_shape(name: str, array: npt.NDArray[Any], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise InputError(f"expected the array {name} of shape {shape}, got {array.shape}")


def _check_covariance(name: str, array: FloatArray, n: int) -> None:
    """Refuse what is not a covariance: not symmetric, or with a negative variance beyond rounding."""
    _check_shape(name, array, (n, n))
    if n:
        whitened, _ = unit_diagonal(array, np.abs(array.diagonal()))
        starts = range(0, n, BLOCK_ROWS)
        differences = (whitened[i : i + BLOCK_ROWS, i:] - whitened[i:, i : i + BLOCK_ROWS].T for i in starts)
        is_symmetric = all(np.abs(difference).max() <= MAX_ASYMMETRY for difference in differences)
        add_to_diagonal(whitened, -LEAST_EIGENVALUE)  # the factor exists if no eigenvalue is below it
        if not is_symmetric or cholesky_solver(whitened) is None:
            raise InputError(f"the array {name} is not a covariance")
