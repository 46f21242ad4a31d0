"""The model file: a zip archive of JSON and arrays, checked before a number of it is used. Never a pickle.

The archive (stored, not compressed) has ``model.json`` and one ``NAME.npy`` (NumPy format 1.0, no objects) for each
array that the JSON lists with its shape and SHA-256, and nothing else. What the JSON has of a model follows from its
class: the constructor's options, and every learned attribute that the class annotates (``fit_: IdentificationResult``),
dataclasses field by field. A field that
a dataclass gains with a default may be missing; one that it loses or changes is a new format. A symmetric matrix is
its lower triangle (format 2), and a covariance that differs from another on the diagonal alone is its diagonal.

The file does not grow with the number of readings: of residuals it has those of outliers.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import types
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass, replace
from dataclasses import Field as DataclassField
from functools import cache
from inspect import get_annotations
from pathlib import Path
from typing import Annotated, Any, ClassVar, Protocol, Union, get_args, get_origin, get_type_hints

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from truearm import __version__
from truearm.arm.arm import NOT_KEPT
from truearm.choices import ModelKind
from truearm.errors import InputError, TruearmError
from truearm.files.file_reading import read_limited
from truearm.identification.estimation.identification_result import IdentificationResult, ReferenceFit
from truearm.identification.estimation.perturbed_chain import PerturbedChain
from truearm.identification.judgement.expansion_prior import NOT_LEARNED
from truearm.identification.judgement.outliers import MIN_ROBUST_WEIGHT
from truearm.identification.terms import SkippedTerm, Term
from truearm.nets.training import TrainingRecord
from truearm.typing import BoolArray, FloatArray, IntArray

# A term of a model with its basis fits.
LINE_WIDTH = 320


def readable_json(value: object, indent: int = 1) -> str:
    """JSON of plain data: a list of numbers, and what is not longer than `LINE_WIDTH`, is one line.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    text = json.dumps(value, allow_nan=False)
    space = " " * indent
    if isinstance(value, dict) and len(text) > LINE_WIDTH:
        entries = [f"{space}{json.dumps(key)}: {readable_json(one, indent + 1)}" for key, one in value.items()]
    elif isinstance(value, list) and len(text) > LINE_WIDTH and any(isinstance(one, dict | list) for one in value):
        entries = [f"{space}{readable_json(one, indent + 1)}" for one in value]
    else:
        return text
    opening, closing = text[0], text[-1]
    return f"{opening}\n" + ",\n".join(entries) + f"\n{space[:-1]}{closing}"


FORMAT = 2
# A 50-50 network and a 7-axis chain need well under a megabyte, a member of 1000 units 8.
MAX_BYTES = 256 * 2**20
# A thousand terms need a third of a megabyte of model.json, ten thousand seats two.
MAX_HEADER_BYTES = 16 * 2**20
MAX_ARRAYS = 10_000
# Arrays in which numbers may be missing or infinite, by the ends of their names.
NOT_FINITE = (".lower", ".upper", *(f".{field.name}" for field in fields(TrainingRecord)))
# Bytes from which a model file is told from other archives: the header of a member, and its name.
MODEL_BEGINS = 40
KIND_HINT = "give a file that truearm fit ... --out MODEL or model.save(MODEL) wrote"
WRITE_HINT = "write it again: truearm fit ... --out MODEL, or model.save(MODEL)"

Array = npt.NDArray[Any]
# A field is an array if its type is one of our names; how NumPy spells them differs between its versions.
DTYPES: dict[Any, type[np.generic]] = {FloatArray: np.float64, IntArray: np.intp, BoolArray: np.bool_}


class _ArrayEntry(BaseModel):
    model_config = ConfigDict(extra="forbid")
    shape: list[Annotated[int, Field(ge=0)]] = Field(max_length=4)
    sha256: str = Field(pattern="^[0-9a-f]{64}$")


class Header(BaseModel):
    """The content of ``model.json``."""

    model_config = ConfigDict(extra="forbid")
    format: Annotated[int, Field(strict=True, ge=1, le=FORMAT)]
    truearm: str
    model: ModelKind
    options: dict[str, Any]
    learned: dict[str, Any]
    arrays: dict[str, _ArrayEntry] = Field(max_length=MAX_ARRAYS)


class SavedModel(Protocol):
    """What a model must have to be saved, beside the learned attributes that its class annotates."""

    kind: ClassVar[str]

    def get_params(self, deep: bool = ...) -> dict[str, Any]:
        """Options of the constructor, by name."""


def model_bytes(model: SavedModel) -> bytes:
    """The content of the model's file: the same for the same model.

    Raises
    ------
    InputError
        If the model is not fitted or not of a `ModelKind`.
    TruearmError
        If it is larger than a model file may be.
    """
    kind = vars(type(model)).get("kind")  # a subclass of a user's own predicts by code that no file has
    if kind not in get_args(ModelKind):
        raise InputError(f"expected a model among {', '.join(get_args(ModelKind))}, got {type(model).__name__}")
    if not hasattr(model, "fit_seconds_"):
        raise InputError(
            f"expected a fitted model, got a {type(model).__name__} that is not fitted", hint="fit it first"
        )
    arrays: dict[str, Array] = {}
    # Without terms of the user's own a file is as it was before there were any.
    options = {
        name: value
        for name, value in model.get_params(deep=False).items()
        if name != "arm" and not (name == "terms" and not value)
    }
    content = {
        "format": FORMAT,
        "truearm": __version__,
        "model": kind,
        "options": {name: _encode(value, name, arrays) for name, value in options.items()},
        "learned": {name: _encode(getattr(model, name), name, arrays) for name in _learned(type(model))},
    }
    files = {f"{name}.npy": _to_bytes(array) for name, array in arrays.items()}
    entries = {
        name: {"shape": list(array.shape), "sha256": hashlib.sha256(files[f"{name}.npy"]).hexdigest()}
        for name, array in arrays.items()
    }
    header = readable_json(content | {"arrays": entries}).encode()
    if len(header) > MAX_HEADER_BYTES or len(arrays) > MAX_ARRAYS or sum(map(len, files.values())) > MAX_BYTES - 2**24:
        raise TruearmError(
            f"the model is larger than a model file may be: {sum(map(len, files.values())) >> 20} MiB in "
            f"{len(arrays)} arrays, {len(header) >> 20} MiB of terms and seats (at most {MAX_BYTES >> 20} MiB, "
            f"{MAX_ARRAYS} arrays, {MAX_HEADER_BYTES >> 20} MiB)"
        )
    content_of_file = io.BytesIO()
    with zipfile.ZipFile(content_of_file, "w") as archive:
        for name, data in {"model.json": header, **files}.items():
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data)  # same model, same file
    return content_of_file.getvalue()


def begins_as_model(head: bytes) -> bool:
    """Whether the first `MODEL_BEGINS` bytes of a file are those of a model file."""
    return head.startswith(b"PK") and head.endswith(b"model.json")


def read_archive(path: str | Path) -> tuple[Header, dict[str, Array]]:
    """The content of a model file, each part checked alone.

    Raises
    ------
    InputError
        If the file is missing, too large, damaged, not a model file, or of another format.
    """
    content = read_limited(path, limit_bytes=MAX_BYTES, hint=WRITE_HINT)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            header = _read_header(archive)
            arrays = {name: _read_array(archive, name, entry) for name, entry in header.arrays.items()}
            if surplus := set(archive.namelist()) - {"model.json", *(f"{name}.npy" for name in arrays)}:
                raise InputError(f"expected only what model.json lists, got also {sorted(surplus)[:3]}")
    except (zipfile.BadZipFile, EOFError, OSError, RuntimeError, NotImplementedError) as error:
        if not begins_as_model(content[:MODEL_BEGINS]):
            raise InputError("expected a model file, got another kind of file", file=path, hint=KIND_HINT) from None
        raise InputError(f"expected a model file, got a damaged one ({error})", file=path, hint=WRITE_HINT) from None
    return header, arrays


def decode_learned(kind: type, header: Header, arrays: Mapping[str, Array]) -> dict[str, Any]:
    """The learned attributes of a class by name, from the content of a model file.

    Raises
    ------
    InputError
        If they are not those that the class annotates, or an array belongs to none.
    """
    hints, unread = _learned(kind), dict(arrays)
    # What a class gained since has a default on the class.
    optional = {name for name in hints if hasattr(kind, name)}
    if not hints.keys() - optional <= header.learned.keys() <= hints.keys():
        raise InputError(f"model.json, learned: expected {', '.join(hints)}, got {', '.join(header.learned)[:60]}")
    learned = {
        name: _decode(hint, header.learned[name], name, unread) if name in header.learned else getattr(kind, name)
        for name, hint in hints.items()
    }
    if unread:
        raise InputError(f"a {header.model} model has no array {sorted(unread)[0]!r}")
    return learned


_hints = cache(get_type_hints)


@cache
def _learned(kind: type) -> dict[str, Any]:
    """Types of the learned attributes that a class annotates, by name."""
    hints: dict[str, Any] = {}
    for cls in reversed(kind.__mro__):
        names = [name for name in get_annotations(cls) if name.endswith("_") and not name.endswith("__")]
        if names:
            hints |= {name: _hints(cls)[name] for name in names}
    return hints


def _encode(value: Any, name: str, arrays: dict[str, Array]) -> Any:
    """Plain data of a value; its arrays are added to `arrays` and referred to by their names."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, np.ndarray):
        is_symmetric = value.ndim == 2 and len(value) > 1 and np.array_equal(value, value.T)
        arrays[name] = value[np.tril_indices(len(value))] if is_symmetric else value
        return {"lower triangle" if is_symmetric else "array": name}
    if isinstance(value, Term):
        return value.as_data()
    if isinstance(value, ReferenceFit):
        value = _outliers_only(value)
    if isinstance(value, IdentificationResult):
        value = _diagonal_only(value)
    if is_dataclass(value):
        parts = {field.name: getattr(value, field.name) for field in _kept_fields(value)}
        return {key: _encode(one, f"{name}.{key}", arrays) for key, one in parts.items()}
    if isinstance(value, Mapping):  # by number: a name of a session or a seat is no name of a file
        return [[key, _encode(one, f"{name}.{i}", arrays)] for i, (key, one) in enumerate(value.items())]
    if isinstance(value, tuple | list):
        return [_encode(one, f"{name}.{i}", arrays) for i, one in enumerate(value)]
    raise TruearmError(f"a model file cannot hold {name}, which is a {type(value).__name__}")


def _kept_fields(kind: Any) -> list[DataclassField[Any]]:
    """The fields of a dataclass that the file keeps."""
    return [field for field in fields(kind) if NOT_KEPT not in field.metadata]


def _outliers_only(reference: ReferenceFit) -> ReferenceFit:
    """A reference with the residuals of outliers: of all readings, a file would grow by 100 bytes a reading."""
    far = reference.robust_weight < MIN_ROBUST_WEIGHT
    return replace(
        reference,
        rows=reference.rows[far],
        residuals=reference.residuals[:, far],
        std=reference.std[:, far],
        robust_weight=reference.robust_weight[far],
        artefact=reference.artefact[far],
        repeat_variance=None if reference.repeat_variance is None else reference.repeat_variance[far],
    )


def _diagonal_only(fit: IdentificationResult) -> IdentificationResult:
    """A fit with the diagonal of its covariance under repeatability conditions, where all else is as on any day."""
    same = fit.repeatability_covariance
    if same is None or not np.array_equal(same, _with_diagonal(fit.covariance, same.diagonal())):
        return fit
    return replace(fit, repeatability_covariance=same.diagonal())


def _with_diagonal(matrix: FloatArray, diagonal: FloatArray) -> FloatArray:
    """A copy of a square matrix with another diagonal."""
    out = matrix.copy()
    np.fill_diagonal(out, diagonal)
    return out


def _decode(hint: Any, data: Any, name: str, arrays: dict[str, Array]) -> Any:
    """The value of a type from plain data; the arrays that it has are taken out of `arrays`."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return _decode(_chosen(arguments, data), data, name, arrays)
    if hint is Term:
        return Term.from_data(data)
    if hint is SkippedTerm:
        return SkippedTerm(*_decode(tuple[str, ...], data, name, arrays))
    if hint in DTYPES:
        return _taken_array(DTYPES[hint], data, name, arrays)
    if is_dataclass(hint):
        build: Callable[..., Any] = hint  # type: ignore[assignment]
        hints = _hints(build)
        names = [field.name for field in _kept_fields(hint)]
        optional = {field.name for field in _kept_fields(hint) if field.default is not MISSING}
        if not isinstance(data, dict) or not set(names) - optional <= data.keys() <= set(names):
            raise InputError(f"model.json, {name}: expected {', '.join(names)}, got {str(data)[:60]}")
        parts = {key: _decode(hints[key], one, f"{name}.{key}", arrays) for key, one in data.items()}
        if hint is IdentificationResult:
            parts["perturbed_chain"] = _in_listed_groups(
                parts["perturbed_chain"], {one.name for one in parts["groups"]}
            )
        if hint is IdentificationResult and (same := parts.get("repeatability_covariance")) is not None:
            whole = parts["covariance"]
            if same.ndim == 1 and whole.shape == 2 * same.shape:
                parts["repeatability_covariance"] = _with_diagonal(whole, same)
        return build(**parts)
    if origin is tuple or origin is dict:
        if not isinstance(data, list):
            raise InputError(f"model.json, {name}: expected a list, got {data!r:.60}")
        if origin is tuple:
            return tuple(_decode(arguments[0], one, f"{name}.{i}", arrays) for i, one in enumerate(data))
        pairs = [(_plain(str, key, name), one) for key, one in data]
        if len(dict(pairs)) < len(pairs):
            raise InputError(f"model.json, {name}: a name is there twice")
        return {key: _decode(arguments[1], one, f"{name}.{i}", arrays) for i, (key, one) in enumerate(pairs)}
    return _plain(hint, data, name)


def _in_listed_groups(chain: PerturbedChain, listed: set[str]) -> PerturbedChain:
    """The chain with the groups that a file lists: early files have terms of "X, not learned" in group X."""
    ends = {name: name + NOT_LEARNED for name in {term.group for term in chain.terms} - listed}
    groups = {name: ended for name, ended in ends.items() if ended in listed}
    terms = (replace(term, group=groups.get(term.group, term.group)) for term in chain.terms)
    return replace(chain, terms=tuple(terms)) if groups else chain


def _chosen(kinds: tuple[Any, ...], data: Any) -> Any:
    """The type of a union that data can be: None, the dataclass with these fields, or the first other one."""
    if data is None and type(None) in kinds:
        return type(None)
    others = [kind for kind in kinds if kind is not type(None)]
    for kind in others:
        if is_dataclass(kind) and isinstance(data, dict) and data.keys() == {field.name for field in fields(kind)}:
            return kind
    return others[0]


def _plain(hint: Any, data: Any, name: str) -> Any:
    if hint is float:
        if data in ("inf", "-inf") or (isinstance(data, int | float) and not isinstance(data, bool)):
            return float(data)
    elif hint in (type(None), bool, int, str) and type(data) is hint:
        return data
    raise InputError(f"model.json, {name}: expected {getattr(hint, '__name__', hint)}, got {data!r:.60}")


def _taken_array(dtype: type[np.generic], data: Any, name: str, arrays: dict[str, Array]) -> Array:
    if data not in ({"array": name}, {"lower triangle": name}) or name not in arrays:
        raise InputError(f"model.json, {name}: expected an array of that name, got {data!r:.60}")
    array = arrays.pop(name)
    if "lower triangle" in data:
        array = symmetric(array, name)
    if dtype is np.float64:
        return array
    whole = array.astype(np.int64) if (np.abs(array) < 2**53).all() else np.full(1, -1)
    if not np.array_equal(whole, array) or (whole < 0).any() or (dtype is np.bool_ and (whole > 1).any()):
        raise InputError(f"expected the array {name} as {'0 and 1' if dtype is np.bool_ else 'whole numbers'}")
    return whole.astype(dtype)


def symmetric(triangle: Array, name: str = "") -> Array:
    """The symmetric matrix of a lower triangle, row after row."""
    size = math.isqrt(2 * triangle.size)
    if triangle.shape != (size * (size + 1) // 2,):
        raise InputError(f"expected the array {name} as a lower triangle, got one of shape {triangle.shape}")
    rows, columns = np.tril_indices(size)
    out = np.empty((size, size))
    out[rows, columns] = out[columns, rows] = triangle
    return out


# The archive ---------------------------------------------------------------------------------------------------------


def _to_bytes(array: Array) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.ascontiguousarray(array, dtype="<f8"), version=(1, 0), allow_pickle=False)
    return stream.getvalue()


def _read_member(archive: zipfile.ZipFile, name: str, limit: int) -> bytes:
    info = archive.getinfo(name)
    if info.file_size > limit or info.compress_type != zipfile.ZIP_STORED:
        raise InputError(f"{name} is compressed or larger than a model needs")
    return archive.read(name)


def _read_header(archive: zipfile.ZipFile) -> Header:
    names = archive.namelist()
    if "model.json" not in names:
        raise InputError("expected a model file, got a zip archive without model.json", hint=KIND_HINT)
    if len(names) > MAX_ARRAYS + 1 or len(set(names)) != len(names):
        raise InputError("the archive has more files than a model file may, or one twice")
    try:
        content = json.loads(_read_member(archive, "model.json", MAX_HEADER_BYTES), parse_constant=_refuse_constant)
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError):
        raise InputError("model.json is not JSON") from None
    given = content.get("format") if isinstance(content, dict) else None
    if isinstance(given, int) and given > FORMAT:
        hint = "update truearm to read it"
        raise InputError(f"expected a model file of format {FORMAT}, got format {given}", hint=hint)
    try:
        return Header.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(f"model.json, {where or 'as a whole'}: {first['msg']}") from None


def _refuse_constant(name: str) -> float:
    raise InputError(f"model.json: expected finite numbers, got {name}")


def _read_array(archive: zipfile.ZipFile, name: str, entry: _ArrayEntry) -> Array:
    data = _read_member(archive, f"{name}.npy", MAX_BYTES)
    if hashlib.sha256(data).hexdigest() != entry.sha256:
        raise InputError(f"the array {name} is not the one that was saved (its SHA-256 differs): the file is damaged")
    stream = io.BytesIO(data)
    # The header is checked before memory is allocated: it might promise any size.
    version = np.lib.format.read_magic(stream)
    if version != (1, 0):
        raise InputError(f"expected the array {name} in format 1.0, got {version}")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    rest = memoryview(data)[stream.tell() :]
    if dtype != np.dtype("<f8") or fortran or list(shape) != entry.shape or len(rest) != 8 * math.prod(shape):
        raise InputError(f"expected the array {name} as doubles of shape {entry.shape}, got {dtype}, {shape}")
    array = np.frombuffer(rest, dtype="<f8").reshape(shape).astype(float)
    if not name.endswith(NOT_FINITE) and not np.isfinite(array).all():
        raise InputError(f"the array {name} has numbers that are not finite")
    return array
