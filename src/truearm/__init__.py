"""True coordinates from the joint angles of an articulated arm: identify, compensate, verify.

Names are imported when they are first used, so that ``import truearm`` is quick. `__init__.pyi` lists the same names
for type checkers and editors.
"""

from importlib import import_module as _import_module
from warnings import warn as _warn

from truearm.wings import public_modules as _public_modules
from truearm.wings import public_names as _public_names

__version__ = "0.1.0"

# Where each public name is defined; the wings say it of theirs.
_HOMES = {
    "truearm.acceptance": ("accepting",),
    "truearm.arm": ("Arm", "list_arms", "load_arm"),
    "truearm.errors": ("InputError",),
    "truearm.identification.terms": ("Expression", "Term"),
    "truearm.models": ("HybridModel", "KinematicModel", "NetworkModel", "NominalModel", "PhysicalModel"),
    "truearm.models.model_file": ("load_model",),
    "truearm.readings": ("Lengths", "Session", "read_lengths", "read_session"),
    "truearm.verbs.diagnose": ("Diagnosis", "diagnose"),
    "truearm.verbs.evaluate": ("Evaluation", "evaluate"),
    "truearm.verbs.fit": ("FitResult", "fit"),
    "truearm.verbs.predict": ("Prediction", "predict"),
    "truearm.verbs.refit": ("RefitResult", "refit"),
    **_public_names(),
}
# Former names, until the next release: a session of any size goes through one verb.
_FORMER = {
    "LargeEvaluation": "Evaluation",
    "LargeFit": "FitResult",
    "LargePrediction": "Prediction",
    "evaluate_large": "evaluate",
    "fit_large": "fit",
    "predict_large": "predict",
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}

_MODULES = _public_modules()

__all__ = sorted([*_HOME_OF, *_MODULES, "__version__"])


def __getattr__(name: str) -> object:
    if name in _MODULES:
        return _import_module(_MODULES[name])
    if name in _FORMER:
        _warn(f"truearm.{name} is truearm.{_FORMER[name]} now", DeprecationWarning, stacklevel=2)
        name = _FORMER[name]
    if name not in _HOME_OF:
        raise AttributeError(f"module 'truearm' has no attribute {name!r}")
    try:
        value = getattr(_import_module(_HOME_OF[name]), name)
    except ModuleNotFoundError as missing:
        if not str(missing.name).startswith("truearm.wings."):
            raise
        raise AttributeError(f"truearm.{name} needs {missing.name}, which was taken off") from None
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return list(__all__)
