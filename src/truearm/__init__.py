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
# Former names, until the next release: a session of any size goes through one verb. Where their attributes are now.
_OF_FIT = (
    "result is the FitResult itself, and its of_sample for the sample alone; n_passes, total, effect and n_effective "
    "are in all_readings, and of_sample is all_readings.why_of_sample"
)
_OF_EVALUATION = (
    "sums.errors is sums.points, sums.remarks is remarks, and n_covered, n_covered_99, variance, n_outliers, outliers "
    "and outliers_of_file of sums are in sums.applies"
)
_OF_PREDICTION = "sums.n_points is sums.n, sums.unstated is unstated_u_mm, and sums.remarks is remarks"
_FORMER = {
    "LargeEvaluation": ("Evaluation", _OF_EVALUATION),
    "LargeFit": ("FitResult", _OF_FIT),
    "LargePrediction": ("Prediction", _OF_PREDICTION),
    "evaluate_large": ("evaluate", _OF_EVALUATION),
    "fit_large": ("fit", _OF_FIT),
    "predict_large": ("predict", _OF_PREDICTION),
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}

_MODULES = _public_modules()

__all__ = sorted([*_HOME_OF, *_MODULES, "__version__"])


def __getattr__(name: str) -> object:
    if name in _MODULES:
        return _import_module(_MODULES[name])
    if name in _FORMER:
        present, attributes = _FORMER[name]
        _warn(f"truearm.{name} is truearm.{present} now: {attributes}", DeprecationWarning, stacklevel=2)
        name = present
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
