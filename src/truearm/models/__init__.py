"""Models of an arm: scikit-learn regressors from joint angles [rad] to tip coordinates [mm]."""

from truearm.models.compensator import Compensator
from truearm.models.kinematic import KinematicModel
from truearm.models.network import NetworkModel
from truearm.models.nominal import NominalModel
from truearm.models.physical import PhysicalModel

MODELS: dict[str, type[Compensator]] = {
    "nominal": NominalModel,
    "kinematic": KinematicModel,
    "physical": PhysicalModel,
    "network": NetworkModel,
}

__all__ = ["MODELS", "Compensator", "KinematicModel", "NetworkModel", "NominalModel", "PhysicalModel"]
