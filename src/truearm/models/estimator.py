"""The protocol of a scikit-learn regressor, without its import.

scikit-learn takes an object for an estimator by its methods, not by its base class, and its import costs more than a
prediction. So the methods are here, and what only scikit-learn itself asks for is imported when it asks.
"""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from truearm.errors import InputError
from truearm.typing import FloatArray

UNCHANGED = "$UNCHANGED$"
"""Of a metadata request: as it was (the value of scikit-learn)."""


class Regressor:
    """Parameters, tags, score and metadata requests of a scikit-learn regressor.

    Its parameters are the arguments of its constructor, which stores each in an attribute of the same name.
    """

    if TYPE_CHECKING:  # what the constructors of all models take

        def __init__(self, arm: Any, **options: Any) -> None: ...

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Parameters of the constructor by name; none is an estimator, whose own `deep` would add."""
        del deep
        return {name: getattr(self, name) for name in _parameters(type(self))}

    def set_params(self, **params: Any) -> Self:
        """Set parameters of the constructor by name.

        Raises
        ------
        InputError
            If there is no parameter of a name.
        """
        known = _parameters(type(self))
        for name, value in params.items():
            if name not in known:
                raise InputError(
                    f"{type(self).__name__} has no parameter {name!r}", hint=f"its parameters are {', '.join(known)}"
                )
            setattr(self, name, value)
        return self

    def score(self, X: npt.ArrayLike, y: npt.ArrayLike, sample_weight: npt.ArrayLike | None = None) -> float:
        """Coefficient of determination of the prediction for X, the mean of the coordinates."""
        from sklearn.metrics import r2_score

        return float(r2_score(y, self.predict(X), sample_weight=sample_weight))  # type: ignore[attr-defined]

    def set_fit_request(self, *, sample_weight: bool | str | None = UNCHANGED) -> Self:
        """Request metadata of `fit` in scikit-learn's metadata routing."""
        return self._request("fit", sample_weight=sample_weight)

    def set_score_request(self, *, sample_weight: bool | str | None = UNCHANGED) -> Self:
        """Request metadata of `score` in scikit-learn's metadata routing."""
        return self._request("score", sample_weight=sample_weight)

    def set_predict_request(self, *, return_cov: bool | str | None = UNCHANGED) -> Self:
        """Request metadata of `predict` in scikit-learn's metadata routing."""
        return self._request("predict", return_cov=return_cov)

    def get_metadata_routing(self) -> Any:
        """Metadata that the methods request, a `sklearn.utils.metadata_routing.MetadataRequest`."""
        from copy import deepcopy

        from sklearn.utils.metadata_routing import MetadataRequest

        if hasattr(self, "_metadata_request"):
            return deepcopy(self._metadata_request)
        request = MetadataRequest(owner=self)
        for method, name in (("fit", "sample_weight"), ("score", "sample_weight"), ("predict", "return_cov")):
            getattr(request, method).add_request(param=name, alias=None)
        return request

    def _request(self, method: str, **aliases: bool | str | None) -> Self:
        from sklearn import get_config

        if not get_config()["enable_metadata_routing"]:
            raise RuntimeError(
                f"set_{method}_request needs metadata routing: call sklearn.set_config(enable_metadata_routing=True)"
            )
        request = self.get_metadata_routing()
        for name, alias in aliases.items():
            if alias != UNCHANGED:
                getattr(request, method).add_request(param=name, alias=alias)
        self._metadata_request = request  # `clone` copies this attribute
        return self

    def __sklearn_tags__(self) -> Any:
        """What scikit-learn's tools must know of it."""
        from sklearn.utils import InputTags, RegressorTags, Tags, TargetTags

        return Tags(
            estimator_type="regressor",
            target_tags=TargetTags(required=True),
            transformer_tags=None,
            regressor_tags=RegressorTags(),
            classifier_tags=None,
            input_tags=InputTags(),
        )

    def __repr__(self) -> str:
        """The constructor's call, with the parameters that differ from their default."""
        given = ", ".join(
            f"{name}={getattr(self, name)!r}"
            for name, default in _parameters(type(self)).items()
            if default is inspect.Parameter.empty or repr(getattr(self, name)) != repr(default)
        )
        return f"{type(self).__name__}({given})"

    def _check_fitted(self) -> None:
        """Raise scikit-learn's `NotFittedError` before the first `fit`."""
        if "n_features_in_" not in vars(self) and not any(name.endswith("_") for name in vars(self)):
            from sklearn.utils.validation import check_is_fitted

            check_is_fitted(self)

    def _checked_table(self, X: npt.ArrayLike) -> FloatArray:
        """A table for `predict` as a finite array of the width of `fit`."""
        if (
            type(X) is np.ndarray
            and X.dtype == np.float64
            and X.ndim == 2
            and len(X) > 0
            and X.shape[1] == vars(self).get("n_features_in_")
            and not hasattr(self, "feature_names_in_")
            and np.isfinite(X).all()
        ):
            return X  # nothing is left for scikit-learn to check
        from sklearn.utils.validation import validate_data

        return np.asarray(validate_data(self, X, reset=False, dtype=np.float64))


def _parameters(kind: type[Regressor]) -> dict[str, Any]:
    """Parameters of a class's constructor by name, with their defaults, in alphabetical order."""
    signature = inspect.signature(kind.__init__)
    return {name: one.default for name, one in sorted(signature.parameters.items()) if name != "self"}


def check_network_options(model: Regressor, **least: int) -> None:
    """Check the hidden layers of a model with networks, and options that are whole numbers of `least` or more."""
    hidden: Any = vars(model)["hidden"]
    if not isinstance(hidden, tuple | list) or not all(isinstance(n, int | np.integer) for n in hidden):
        raise InputError(f"expected hidden layers as whole numbers, such as (30, 30), got {hidden!r}")
    for name, lower in least.items():
        value = getattr(model, name)
        if not isinstance(value, int | np.integer) or value < lower:
            raise InputError(f"expected {name} as a whole number of {lower} or more, got {value!r}")
