"""Models of an arm: scikit-learn regressors from joint angles [rad] to tip coordinates [mm]."""

from truearm.models.compensator import Compensator
from truearm.models.hybrid import HybridModel
from truearm.models.identified_model import IdentifiedModel, KinematicModel, NominalModel, PhysicalModel
from truearm.models.model_file import MODELS, load_model
from truearm.models.network import NetworkModel

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
