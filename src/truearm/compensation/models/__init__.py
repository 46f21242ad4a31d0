"""Models of an arm: scikit-learn regressors from joint angles [rad] to tip coordinates [mm]."""

from truearm.compensation.models.compensator import Compensator
from truearm.compensation.models.kinematic import KinematicModel
from truearm.compensation.models.network import NetworkModel
from truearm.compensation.models.nominal import NominalModel
from truearm.compensation.models.physical import PhysicalModel

MODELS: dict[str, type[Compensator]] = {
    "nominal": NominalModel,
    "kinematic": KinematicModel,
    "physical": PhysicalModel,
    "network": NetworkModel,
}

__all__ = ["MODELS", "Compensator", "KinematicModel", "NetworkModel", "NominalModel", "PhysicalModel"]
