"""Models of an arm: scikit-learn regressors from joint angles [rad] to tip coordinates [mm]."""

from truearm.compensation.models.compensator import Compensator
from truearm.compensation.models.hybrid import HybridModel
from truearm.compensation.models.identified_model import IdentifiedModel, KinematicModel, NominalModel, PhysicalModel
from truearm.compensation.models.model_file import MODELS, load_model
from truearm.compensation.models.network import NetworkModel

__all__ = [
    "MODELS",
    "Compensator",
    "HybridModel",
    "IdentifiedModel",
    "KinematicModel",
    "NetworkModel",
    "NominalModel",
    "PhysicalModel",
    "load_model",
]
