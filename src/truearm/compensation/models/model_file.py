"""The model file: JSON and arrays in a zip, checked before a number of it is used. Never a pickle.

A zip archive (stored, not compressed) with ``model.json`` and one ``NAME.npy`` (format 1.0, no objects) for each
array that the JSON lists with its shape and SHA-256. Nothing else may be in it.

Format 4 brought masses of the arm's links, the direction of gravity, where in the joint space more is unexplained, the
widening of the posterior, and variances of temperature and columns (0 before: not known).
Format 3 brought identified terms as data with their posterior; formats 1 and 2 had six constants of every place only,
already moved into the chain. Format 2 brought ensembles of networks (a member's numbers are a row of the arrays) and
the records of their trainings; format 1 had one network without its record.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import zipfile
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from truearm import __version__
from truearm.arm.arm import Arm
from truearm.arm.chain import Chain
from truearm.arm.masses import LinkMasses
from truearm.compensation.models import MODELS
from truearm.compensation.models.compensator import Compensator
from truearm.compensation.models.identified_model import IdentifiedModel
from truearm.compensation.models.network import Member, NetworkModel
from truearm.compensation.models.session_frames import checked_frames
from truearm.compensation.nets.perceptron import Perceptron
from truearm.compensation.nets.scaling import MinMaxScaler
from truearm.compensation.nets.trainbr import BayesianRecord
from truearm.compensation.nets.traingdx import AdaptiveRecord
from truearm.compensation.nets.training import TrainingRecord
from truearm.errors import InputError, TruearmError
from truearm.files.atomic_write import atomic_file
from truearm.identification.estimation.cross_validation import birge_ratio
from truearm.identification.estimation.identification import IdentificationResult, ReferenceFit, TermGroupResult
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.estimation.residual_variance import HeldOutReadings, VarianceFunction
from truearm.identification.terms import Constant, SkippedTerm, Term
from truearm.typing import FloatArray

FORMAT = 4
# A 50-50 network and a 7-axis chain need well under a megabyte, a member of 1000 units 8; save_model writes no more.
MAX_BYTES = 256 * 2**20
# A thousand terms stand in a third of a megabyte of model.json, ten thousand seats in two.
MAX_HEADER_BYTES = 16 * 2**20
MAX_ARRAYS = 100
MAX_COUNT = 10**9  # of readings, rounds, epochs
# Kinds of training records, by the names of their columns.
RECORDS: dict[tuple[str, ...], type[TrainingRecord]] = {
    tuple(field.name for field in fields(kind) if field.name not in ("best_epoch", "stop")): kind
    for kind in (TrainingRecord, BayesianRecord, AdaptiveRecord)
}
# Identifications of a model, the arrays of its variance function, and those of its readings held out.
IDENTIFIED: tuple[Literal["nominal_"], Literal["fit_"]] = ("nominal_", "fit_")
# What formats 1 and 2 had of an identification, and options that evidence has made idle since.
OLD_FIT = ("chain_fixed", "chain_tip", "motions", "covariance", "weights")
OLD_OPTIONS = ("prior_angle", "prior_length")
SHARES = ("centre", "spread", "slope", "curvature")
HELD_OUT = ("rows", "group", "deviations", "covariance", "freedom")
# Arrays in which numbers may be missing or without bound.
NOT_FINITE = ("arm_limits", "network_record")


class _ArrayEntry(BaseModel):
    model_config = ConfigDict(extra="forbid")
    shape: list[int]
    sha256: str = Field(pattern="^[0-9a-f]{64}$")


class _ArmEntry(BaseModel):
    model_config = ConfigDict(extra="forbid")
    name: str
    title: str
    joint_names: list[str]
    source: str


class _MemberEntry(BaseModel):
    """A network of an ensemble; of its training, what is no number an epoch."""

    model_config = ConfigDict(extra="forbid")
    start: int = Field(ge=0)
    epochs: int = Field(ge=0, le=MAX_COUNT)
    best_epoch: int = Field(ge=0)
    stop: str = Field(max_length=200)


class _GroupEntry(BaseModel):
    model_config = ConfigDict(extra="forbid")
    name: str = Field(max_length=200)
    n_coefficients: int = Field(ge=0, le=MAX_COUNT)
    effective: float = Field(ge=0, allow_inf_nan=False)
    scale: float = Field(ge=0, allow_inf_nan=False)


class _ReferenceEntry(BaseModel):
    """What is no array of a reference."""

    model_config = ConfigDict(extra="forbid")
    kind: str = Field(max_length=40)
    noise_std_mm: float = Field(ge=0, allow_inf_nan=False)
    unknowns: dict[str, Annotated[float, Field(allow_inf_nan=False)]]


class _IdentifiedEntry(BaseModel):
    """What is no array of an identification."""

    model_config = ConfigDict(extra="forbid")
    terms: list[dict[str, Any]]
    groups: list[_GroupEntry]
    references: list[_ReferenceEntry] = Field(min_length=1, max_length=10)
    converged: bool
    rounds: int = Field(ge=0, le=MAX_COUNT)


class _Header(BaseModel):
    """What stands in ``model.json``."""

    model_config = ConfigDict(extra="forbid")
    format: Annotated[int, Field(strict=True, ge=1, le=FORMAT)]
    truearm: str
    model: Literal["nominal", "kinematic", "physical", "network"]
    options: dict[str, Any]
    arm: _ArmEntry
    n_train: int = Field(ge=1, le=MAX_COUNT)
    data_fingerprint: str = Field(pattern="^[0-9a-f]{64}$")
    lengths_fingerprint: str = Field("", pattern="^([0-9a-f]{64})?$")
    fit_seconds: float = Field(ge=0)
    facts: dict[str, Annotated[float, Field(ge=0, allow_inf_nan=False)]]
    arrays: dict[str, _ArrayEntry] = Field(max_length=MAX_ARRAYS)
    identified: dict[Literal["nominal_", "fit_"], _IdentifiedEntry] = {}
    free: list[Literal["base", "tip"]] | None = None
    left_out: list[tuple[str, str]] = []
    column_means: dict[str, Annotated[float, Field(allow_inf_nan=False)]] = {}
    column_variances: dict[str, Annotated[float, Field(ge=0, allow_inf_nan=False)]] = {}
    temperature_degC: Annotated[float, Field(allow_inf_nan=False)] | None = None
    temperature_variance_K2: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = None
    sessions: list[str] = []
    members: list[_MemberEntry] = []
    record: tuple[str, ...] = ()


def save_model(model: Compensator, path: str | Path) -> None:
    """Write a fitted model to one file, whole or not at all.

    Parameters
    ----------
    model : Compensator
        Fitted.
    path : path
        Any name; ``.truearm`` by custom.

    Raises
    ------
    TruearmError
        If the model is not fitted, not one of `truearm.compensation.models.MODELS`, or larger than a model file may be.
    """
    kind = next((name for name, cls in MODELS.items() if type(model) is cls), None)
    if kind is None or not hasattr(model, "nominal_"):
        raise TruearmError(f"expected a fitted model ({', '.join(MODELS)}), got {type(model).__name__}, fitted or not")
    arrays, facts = _taken_apart(model)
    if sum(array.nbytes for array in arrays.values()) > MAX_BYTES - 2**20:
        raise TruearmError(f"{path}: the model does not fit a model file of {MAX_BYTES >> 20} MiB")
    trained = _trained(model)
    header = _Header(
        format=FORMAT,
        truearm=__version__,
        model=kind,  # type: ignore[arg-type]
        options=_options(model),
        arm=_ArmEntry(
            name=model.arm.name, title=model.arm.title, joint_names=list(model.arm.joint_names), source=model.arm.source
        ),
        n_train=model.n_train_,
        data_fingerprint=model.data_fingerprint_,
        lengths_fingerprint=model.lengths_fingerprint_,
        fit_seconds=model.fit_seconds_,
        facts=facts,
        arrays={
            name: _ArrayEntry(shape=list(array.shape), sha256=hashlib.sha256(_bytes(array)).hexdigest())
            for name, array in arrays.items()
        },
        identified={name: _entry(getattr(model, name)) for name in IDENTIFIED if hasattr(model, name)},
        free=list(model.free_),  # type: ignore[arg-type]
        left_out=[(left_out.name, left_out.reason) for left_out in getattr(model, "excluded_terms_", ())],
        column_means=getattr(model, "columns_", {}),
        column_variances=getattr(model, "column_variances_", {}),
        temperature_degC=getattr(model, "temperature_degC_", None),
        temperature_variance_K2=getattr(model, "temperature_variance_K2_", None),
        sessions=list(model.session_frames_),
        members=[
            _MemberEntry(start=member.start, epochs=record.num_epochs, best_epoch=record.best_epoch, stop=record.stop)
            for member, record in trained
        ],
        record=_record_names(trained[0][1]) if trained else (),
    )
    head = header.model_dump_json(indent=1).encode()
    if len(head) > MAX_HEADER_BYTES:
        raise TruearmError(f"{path}: the model does not fit a model file: {len(head) >> 20} MiB of terms and seats")
    with atomic_file(path) as beside, zipfile.ZipFile(beside, "w") as archive:
        _put(archive, "model.json", head)
        for name, array in arrays.items():
            _put(archive, f"{name}.npy", _bytes(array))


def load_model(path: str | Path) -> Compensator:
    """Read a model file.

    Returns
    -------
    Compensator
        Fitted, predicting the same numbers to the last bit.

    Raises
    ------
    InputError
        If the file is missing, too large, damaged, foreign, or of a newer format.
    """
    path = Path(path)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(
                f"expected a model file of at most {MAX_BYTES >> 20} MiB, got {path.stat().st_size >> 20} MiB"
            )
        with zipfile.ZipFile(path) as archive:
            header = _header(archive)
            arrays = {name: _array(archive, name, entry) for name, entry in header.arrays.items()}
            foreign = set(archive.namelist()) - {"model.json", *(f"{name}.npy" for name in arrays)}
            if foreign:
                raise InputError(f"expected only what model.json lists, got also {sorted(foreign)[:3]}")
        model = _put_together(header, arrays)
        known = set(_taken_apart(model)[0])
        if header.format < 3:
            known |= {name + part for name in IDENTIFIED if hasattr(model, name) for part in OLD_FIT}
        if surplus := set(arrays) - known:
            raise InputError(f"a {header.model} model has no array {sorted(surplus)[0]!r}")
        _check_predicts(model)
        return model
    except FileNotFoundError:
        raise InputError("there is no such file", file=path, hint="truearm fit ... --out MODEL writes one") from None
    except (zipfile.BadZipFile, EOFError, OSError, RuntimeError, NotImplementedError) as error:
        raise InputError(
            f"expected a model file, got something else or a damaged one ({error})",
            file=path,
            hint="truearm fit ... --out MODEL writes one",
        ) from None
    except InputError as error:
        raise error.in_file(path) from None
    except (LookupError, ValueError, TypeError) as error:
        raise InputError(f"the model file does not hold what its kind of model needs ({error})", file=path) from None


def _options(model: Compensator) -> dict[str, Any]:
    """The constructor's options but for the arm, as JSON has them."""

    def plain(value: Any) -> Any:
        if isinstance(value, tuple | list):
            return [plain(part) for part in value]
        return value.item() if isinstance(value, np.generic) else value

    return {name: plain(value) for name, value in model.get_params(deep=False).items() if name != "arm"}


def _taken_apart(model: Compensator) -> tuple[dict[str, FloatArray], dict[str, float]]:
    arm = model.arm
    arrays: dict[str, FloatArray] = {
        "arm_limits": arm.limits,
        "arm_working_pose": arm.working,
        "arm_prismatic": arm.chain.is_prismatic.astype(float),
        "arm_gravity": arm.gravity_direction,
        "angle_ranges": model.angle_ranges_,
        "angle_gaps": model.angle_gaps_,
        **_chain_arrays("arm", arm.chain),
    }
    if arm.masses is not None:
        arrays |= {"arm_masses": arm.masses.mass_kg, "arm_mass_centres": arm.masses.centre_in_joint_mm}
    if model.session_frames_:
        arrays["session_frames"] = np.stack(list(model.session_frames_.values()))
    facts: dict[str, float] = {}
    for name in IDENTIFIED:
        if hasattr(model, name):
            arrays |= _identified_arrays(name, getattr(model, name))
    if isinstance(model, IdentifiedModel):
        facts["unexplained_std_mm"] = model.residual_std_
        facts["widening"] = model.birge_ratio_
        arrays["refitted_on"] = model.refit_reading_ids_
        shares = model.variance_function_
        arrays |= {f"unexplained_{part}": getattr(shares, part) for part in SHARES}
        facts["unexplained_mean_share"] = shares.mean
        arrays |= {f"held_out_{part}": _doubles(getattr(model.held_out_, part)) for part in HELD_OUT}
    if isinstance(model, NetworkModel):
        arrays |= {
            "network_weights": np.stack([member.weights for member in model.members_]),
            "network_residual_covariance": model.residual_covariance_,
            "network_basis_covariance": np.stack([member.basis_covariance for member in model.members_]),
        }
        trained = _trained(model)
        if trained:
            arrays["network_record"] = np.concatenate([_record_table(record) for _, record in trained])
        for scaled in ("angle_scale_", "point_scale_"):
            scale: MinMaxScaler = getattr(model, scaled)
            arrays[scaled + "range"] = np.stack([scale.lower, scale.upper])
    return arrays, facts


def _trained(model: Compensator) -> list[tuple[Member, TrainingRecord]]:
    """Members with the records of their trainings, as far as there are any."""
    members = model.members_ if isinstance(model, NetworkModel) else ()
    return [(member, member.record) for member in members if member.record is not None]


def _record_names(record: TrainingRecord) -> tuple[str, ...]:
    return next(names for names, kind in RECORDS.items() if type(record) is kind)


def _record_table(record: TrainingRecord) -> FloatArray:
    """A record's numbers, a row an epoch."""
    return np.stack([np.asarray(getattr(record, name), dtype=float) for name in _record_names(record)], axis=1)


def _put_together(header: _Header, arrays: dict[str, FloatArray]) -> Compensator:
    n = len(header.arm.joint_names)
    prismatic = _shaped(arrays, "arm_prismatic", (n,)) > 0.5
    limits = _shaped(arrays, "arm_limits", (n, 2))
    arm = Arm(
        header.arm.name,
        _chain("arm", arrays, prismatic),
        title=header.arm.title,
        joint_names=tuple(header.arm.joint_names),
        lower=limits[:, 0],
        upper=limits[:, 1],
        working_pose=_shaped(arrays, "arm_working_pose", (n,)),
        source=header.arm.source,
        masses=LinkMasses(arrays["arm_masses"], arrays["arm_mass_centres"]) if "arm_masses" in arrays else None,
        gravity_in_base=_shaped(arrays, "arm_gravity", (3,)) if header.format > 3 else None,
    )
    options = {name: tuple(value) if isinstance(value, list) else value for name, value in header.options.items()}
    old = header.format < 3
    if old and header.model == "kinematic":
        options = {name: value for name, value in options.items() if name not in OLD_OPTIONS}
    model = MODELS[header.model](arm, **options)
    model._check_options()
    model.arm_ = arm
    model.n_features_in_ = n
    model.n_train_, model.fit_seconds_ = header.n_train, header.fit_seconds
    model.data_fingerprint_ = header.data_fingerprint
    model.lengths_fingerprint_ = header.lengths_fingerprint
    model.angle_ranges_ = _shaped(arrays, "angle_ranges", (n, 2))
    model.angle_gaps_ = np.zeros((0, 3)) if old else _gaps(arrays["angle_gaps"], n)
    model.free_ = tuple(model.free if header.free is None else header.free)
    model.session_frames_ = checked_frames(header.sessions, arrays["session_frames"]) if header.sessions else {}
    model.nominal_ = (_old_fit if old else _identified)("nominal_", header, arrays, prismatic)
    if isinstance(model, IdentifiedModel):
        if old and header.model == "nominal":
            model.fit_ = model.nominal_
        else:
            model.fit_ = (_old_fit if old else _identified)("fit_", header, arrays, prismatic)
        model.excluded_terms_ = tuple(SkippedTerm(name, reason) for name, reason in header.left_out)
        _put_conditions(model, header)
        model.refit_reading_ids_ = np.zeros(0) if old else _marks(arrays["refitted_on"])
        noise = model.fit_.references[0].noise_std
        model.residual_std_ = noise if old else header.facts["unexplained_std_mm"]
        model.variance_function_ = _shares(header, arrays, n)
        model.held_out_ = _held_out(header, arrays)
        model.birge_ratio_ = _widening(model, header)
    if isinstance(model, NetworkModel):
        _put_network(model, header, arrays)
    return model


def _put_conditions(model: IdentifiedModel, header: _Header) -> None:
    """Temperature and columns of the training readings; before format 4 it was not kept how they varied."""
    model.columns_, model.temperature_degC_ = dict(header.column_means), header.temperature_degC
    if header.format < 4:
        model.column_variances_ = dict.fromkeys(model.columns_, 0.0)
        model.temperature_variance_K2_ = None if model.temperature_degC_ is None else 0.0
        return
    model.column_variances_ = dict(header.column_variances)
    model.temperature_variance_K2_ = header.temperature_variance_K2
    if model.column_variances_.keys() != model.columns_.keys():
        raise InputError("expected a mean and a variance of every column in model.json")
    if (model.temperature_variance_K2_ is None) != (model.temperature_degC_ is None):
        raise InputError("expected a mean and a variance of the temperature in model.json")


def _widening(model: IdentifiedModel, header: _Header) -> float:
    if header.format < 4:
        return birge_ratio(model.fit_.references, model.held_out_.rows, model.residual_std_)
    if header.facts["widening"] < 1:
        raise InputError(f"expected a widening of 1 or more in model.json, got {header.facts['widening']:g}")
    return header.facts["widening"]


def _shares(header: _Header, arrays: dict[str, FloatArray], n: int) -> VarianceFunction:
    """Where more is unexplained than elsewhere; before format 4 that was the same everywhere."""
    if header.format < 4:
        return VarianceFunction.flat(n)
    found = {part: _shaped(arrays, f"unexplained_{part}", (n,)) for part in SHARES}
    return VarianceFunction(**found, mean=header.facts["unexplained_mean_share"])


def _check_predicts(model: Compensator) -> None:
    """Refuse terms that the arm has no joint or the model no data for, and numbers beyond all bounds."""
    with np.errstate(all="ignore"):
        nominal = model.predict_nominal(model.arm.working[None])
        points, covariance = model.predict(model.arm.working[None], return_cov=True)
    if not all(np.isfinite(found).all() for found in (nominal, points, covariance)):
        raise InputError("the model does not predict finite numbers at the arm's working pose")


def _entry(fit: IdentificationResult) -> _IdentifiedEntry:
    return _IdentifiedEntry(
        terms=[term.as_data() for term in fit.perturbed_chain.terms],
        groups=[
            _GroupEntry(name=g.name, n_coefficients=g.n_coefficients, effective=g.effective, scale=g.scale)
            for g in fit.groups
        ],
        references=[
            _ReferenceEntry(kind=r.kind, noise_std_mm=r.noise_std, unknowns=r.unknowns) for r in fit.references
        ],
        converged=fit.converged,
        rounds=fit.rounds,
    )


def _identified_arrays(name: str, fit: IdentificationResult) -> dict[str, FloatArray]:
    found = {
        **_chain_arrays(name + "chain", fit.perturbed_chain.chain),
        name + "coefficients": fit.coefficients,
        name + "covariance": fit.covariance,
        name + "prior_std": fit.prior_std,
    }
    for i, reference in enumerate(fit.references):
        found |= {
            f"{name}rows_{i}": _doubles(reference.rows),
            f"{name}residuals_{i}": reference.residuals,
            f"{name}std_{i}": reference.std,
            f"{name}artefact_{i}": _doubles(reference.artefact),
            f"{name}trust_{i}": reference.robust_weight,
        }
    return found


def _identified(
    name: str, header: _Header, arrays: dict[str, FloatArray], prismatic: npt.NDArray[np.bool_]
) -> IdentificationResult:
    if name not in header.identified:
        raise InputError(f"model.json does not say what {name} is")
    entry = header.identified[name]
    chain = _chain(name + "chain", arrays, prismatic)
    terms = tuple(Term.from_data(data) for data in entry.terms)
    for term in terms:
        term.check_place(chain)
    perturbed_chain = PerturbedChain(chain, terms)
    n = perturbed_chain.n_coefficients
    prior_std = _shaped(arrays, name + "prior_std", (n,))
    if not (prior_std > 0).all():
        raise InputError(f"the array {name}prior_std must be above zero")
    # The readings may be those of a later session, in which only base and tip were identified.
    n_readings = header.n_train + len(arrays.get("refitted_on", ()))
    explained = []
    for i, reference in enumerate(entry.references):
        rows = _indices(arrays[f"{name}rows_{i}"], f"{name}rows_{i}", n_readings)
        residuals = arrays[f"{name}residuals_{i}"]
        std = _shaped(arrays, f"{name}std_{i}", residuals.shape)
        if (std < 0).any():
            raise InputError(f"the array {name}std_{i} must be 0 or more")
        trust = _shaped(arrays, f"{name}trust_{i}", (len(rows),))
        if not ((trust >= 0) & (trust <= 1)).all():
            raise InputError(f"the array {name}trust_{i} must be from 0 to 1")
        _of_shape(residuals, f"{name}residuals_{i}", (*residuals.shape[:1], len(rows)))
        explained.append(
            ReferenceFit(
                reference.kind,
                rows,
                residuals,
                std,
                reference.noise_std_mm,
                trust,
                _indices(_shaped(arrays, f"{name}artefact_{i}", (len(rows),)), f"{name}artefact_{i}", n_readings),
                dict(reference.unknowns),
            )
        )
    return IdentificationResult(
        perturbed_chain,
        _shaped(arrays, name + "coefficients", (n,)),
        _covariance(arrays[name + "covariance"], name + "covariance", n),
        prior_std,
        tuple(TermGroupResult(g.name, g.n_coefficients, g.effective, g.scale) for g in entry.groups),
        tuple(explained),
        entry.converged,
        entry.rounds,
    )


def _old_fit(
    name: str, header: _Header, arrays: dict[str, FloatArray], prismatic: npt.NDArray[np.bool_]
) -> IdentificationResult:
    """A fit of formats 1 and 2: its constants are in the chain, their covariance is that of small motions there."""
    places = len(prismatic) + 2
    covariance = _covariance(arrays[name + "covariance"], name + "covariance", places * 6)
    _shaped(arrays, name + "motions", (places, 6))
    _shaped(arrays, name + "weights", (header.n_train,))
    terms = tuple(
        Term(f"place {i}, component {k}", i, tuple(float(k == j) for j in range(6)), Constant(), "constants", 1.0)
        for i in range(places)
        for k in range(6)
    )
    none, noise = np.zeros(0, dtype=np.intp), header.facts[name + "noise_std_mm"]
    return IdentificationResult(
        PerturbedChain(_chain(name + "chain", arrays, prismatic), terms),
        np.zeros(places * 6),
        covariance,
        np.ones(places * 6),
        (TermGroupResult("constants", places * 6, 0.0, 1.0),),
        # Their residuals were not kept.
        (ReferenceFit("point", none, np.zeros((3, 0)), np.zeros((3, 0)), noise, np.zeros(0), none, {}),),
        bool(header.facts[name + "converged"]),
        0,
    )


def _held_out(header: _Header, arrays: dict[str, FloatArray]) -> HeldOutReadings:
    if header.format < 3:
        empty = np.zeros(0, dtype=np.intp)
        return HeldOutReadings(empty, empty, np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))
    rows = _indices(arrays["held_out_rows"], "held_out_rows", header.n_train)
    m = len(rows)
    freedom = _shaped(arrays, "held_out_freedom", (m,))
    if not ((freedom > 0) & (freedom <= 1)).all():
        raise InputError("the array held_out_freedom must be above 0 and at most 1")
    covariance = _shaped(arrays, "held_out_covariance", (m, 3, 3))
    size = np.abs(covariance).max(axis=(1, 2))
    skew = np.abs(covariance - covariance.transpose(0, 2, 1)).max(axis=(1, 2))
    if (skew > 1e-6 * size).any() or (np.linalg.eigvalsh(covariance)[:, 0] < -1e-6 * size).any():
        raise InputError("the array held_out_covariance does not hold covariances")
    return HeldOutReadings(
        rows,
        _indices(_shaped(arrays, "held_out_group", (m,)), "held_out_group", header.n_train),
        _shaped(arrays, "held_out_deviations", (m, 3)),
        covariance,
        freedom,
    )


def _doubles(array: npt.ArrayLike) -> FloatArray:
    return np.asarray(array, dtype=float)


def _gaps(array: FloatArray, n_joints: int) -> FloatArray:
    _of_shape(array, "angle_gaps", (len(array), 3))
    _indices(array[:, 0], "angle_gaps", n_joints)
    if not (array[:, 1] < array[:, 2]).all():
        raise InputError("the gaps of the array angle_gaps must begin before they end")
    return array


def _marks(array: FloatArray) -> FloatArray:
    _indices(array, "refitted_on", 2**53)
    return array


def _indices(array: FloatArray, name: str, n: int) -> npt.NDArray[np.intp]:
    """Whole numbers below n."""
    if array.ndim != 1 or not ((array >= 0) & (array < n) & (array == np.floor(array))).all():
        raise InputError(f"expected the array {name} as whole numbers below {n}")
    return array.astype(np.intp)


def _put_network(model: NetworkModel, header: _Header, arrays: dict[str, FloatArray]) -> None:
    n_joints = model.arm.n_joints
    network = Perceptron.with_layers(n_joints, model.hidden, 3, activation=model.activation)
    model.network_ = network
    weights, inverses = arrays["network_weights"], arrays["network_basis_covariance"]
    if header.format == 1:
        weights, inverses = weights[None], inverses[None]
    n_members = len(weights)
    if not n_members or len(inverses) != n_members or (header.members and len(header.members) != n_members):
        raise InputError(f"expected as many rows of every array as there are members, got {n_members} of the weights")
    model.members_ = tuple(
        Member(
            _of_shape(row, "network_weights", (network.n_weights,)),
            _covariance(inverse, "network_basis_covariance", network.sizes[-2] + 1),
            start,
            record,
        )
        for row, inverse, (start, record) in zip(weights, inverses, _trainings(header, arrays, n_members), strict=True)
    )
    model.residual_covariance_ = _covariance(arrays["network_residual_covariance"], "network_residual_covariance", 3)
    for name, k in (("angle_scale_", n_joints), ("point_scale_", 3)):
        lower, upper = _shaped(arrays, name + "range", (2, k))
        if not (lower < upper).all():
            raise InputError(f"the array {name}range must rise from its first row to its second")
        setattr(model, name, MinMaxScaler(lower, upper))


def _trainings(
    header: _Header, arrays: dict[str, FloatArray], n_members: int
) -> list[tuple[int, TrainingRecord | None]]:
    """Start and record of every member; a file without records (format 1, and what came of it) tells neither."""
    if not header.members:
        return [(0, None)] * n_members
    if header.record not in RECORDS:
        raise InputError(f"unknown columns of a training's record: {list(header.record)}")
    ends = np.cumsum([member.epochs + 1 for member in header.members])
    table = _shaped(arrays, "network_record", (int(ends[-1]), len(header.record)))
    out: list[tuple[int, TrainingRecord | None]] = []
    for member, rows in zip(header.members, np.split(table, ends[:-1]), strict=True):
        columns: dict[str, Any] = dict(zip(header.record, rows.T, strict=True))
        fails = columns["val_fail"]
        if member.best_epoch > member.epochs or not ((fails >= 0) & (fails <= member.epochs)).all():
            raise InputError("a training's record does not hold what its members say of it")
        columns["val_fail"] = fails.astype(np.intp)
        record = RECORDS[header.record](**columns, best_epoch=member.best_epoch, stop=member.stop)
        out.append((member.start, record))
    return out


def _chain_arrays(name: str, chain: Chain) -> dict[str, FloatArray]:
    return {f"{name}_fixed": chain.fixed, f"{name}_tip": chain.tip_in_flange}


def _chain(name: str, arrays: dict[str, FloatArray], prismatic: npt.NDArray[np.bool_]) -> Chain:
    return Chain(arrays[f"{name}_fixed"], arrays[f"{name}_tip"], prismatic)


def _shaped(arrays: dict[str, FloatArray], name: str, shape: tuple[int, ...]) -> FloatArray:
    return _of_shape(arrays[name], name, shape)


def _of_shape(array: FloatArray, name: str, shape: tuple[int, ...]) -> FloatArray:
    if array.shape != shape:
        raise InputError(f"expected the array {name} of shape {shape}, got {array.shape}")
    return array


def _covariance(array: FloatArray, name: str, n: int) -> FloatArray:
    """A covariance: symmetric, no negative variance beyond rounding."""
    _of_shape(array, name, (n, n))
    if not n:  # nothing was free
        return array
    scale = np.sqrt(np.abs(array.diagonal()))
    scale[scale == 0] = 1
    whitened = array / np.outer(scale, scale)
    if np.abs(whitened - whitened.T).max() > 1e-6 or np.linalg.eigvalsh(whitened)[0] < -1e-6:
        raise InputError(f"the array {name} is not a covariance")
    return array


def _put(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    # A fixed date: the same model gives the same file.
    archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data)


def _bytes(array: FloatArray) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.ascontiguousarray(array, dtype="<f8"), version=(1, 0), allow_pickle=False)
    return stream.getvalue()


def _read(archive: zipfile.ZipFile, name: str, most: int = MAX_BYTES) -> bytes:
    info = archive.getinfo(name)
    if info.file_size > most or info.compress_type != zipfile.ZIP_STORED:
        raise InputError(f"{name} is compressed or larger than a model needs")
    return archive.read(name)


def _header(archive: zipfile.ZipFile) -> _Header:
    if "model.json" not in archive.namelist():
        raise InputError("expected a model file, got a zip archive without model.json")
    if len(archive.namelist()) > MAX_ARRAYS + 1 or len(set(archive.namelist())) != len(archive.namelist()):
        raise InputError("the archive holds more files than a model file may, or one twice")
    try:
        found = json.loads(_read(archive, "model.json", MAX_HEADER_BYTES))
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError):
        raise InputError("model.json is not JSON") from None
    given = found.get("format") if isinstance(found, dict) else None
    if isinstance(given, int) and given > FORMAT:
        raise InputError(
            f"expected a model file of format {FORMAT} or older, got format {given}", hint="update truearm to read it"
        )
    try:
        return _Header.model_validate(found)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(f"model.json, {where or 'as a whole'}: {first['msg']}") from None


def _array(archive: zipfile.ZipFile, name: str, entry: _ArrayEntry) -> FloatArray:
    data = _read(archive, f"{name}.npy")
    if hashlib.sha256(data).hexdigest() != entry.sha256:
        raise InputError(f"the array {name} is not the one that was saved (its SHA-256 differs): the file is damaged")
    stream = io.BytesIO(data)
    # The header is checked before memory is taken: it might promise any size.
    version = np.lib.format.read_magic(stream)
    if version != (1, 0):
        raise InputError(f"expected the array {name} in format 1.0, got {version}")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    rest = data[stream.tell() :]
    if dtype != np.dtype("<f8") or fortran or list(shape) != entry.shape or len(rest) != 8 * math.prod(shape):
        raise InputError(f"expected the array {name} as doubles of shape {entry.shape}, got {dtype}, {shape}")
    array = np.frombuffer(rest, dtype="<f8").reshape(shape).astype(float)
    if name not in NOT_FINITE and not np.isfinite(array).all():
        raise InputError(f"the array {name} holds numbers that are not finite")
    return array
