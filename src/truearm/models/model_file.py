"""The kinds of models, and a model read from its file."""

from __future__ import annotations

from pathlib import Path

from truearm.errors import InputError
from truearm.identification.terms import Term
from truearm.models.compensator import Compensator
from truearm.models.hybrid import HybridModel
from truearm.models.identified_model import KinematicModel, NominalModel, PhysicalModel
from truearm.models.model_archive import (
    Array,
    Header,
    decode_learned,
    read_archive,
)
from truearm.models.model_file_checks import check_model
from truearm.models.network import NetworkModel
from truearm.solve.threads import one_blas_thread

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
