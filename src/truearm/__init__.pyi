"""The public names, for type checkers and editors; `__init__.py` imports them when they are used."""

from truearm import datasets as datasets
from truearm.arm import Arm as Arm
from truearm.arm import list_arms as list_arms
from truearm.arm import load_arm as load_arm
from truearm.compensation.models import KinematicModel as KinematicModel
from truearm.compensation.models import NetworkModel as NetworkModel
from truearm.compensation.models import NominalModel as NominalModel
from truearm.compensation.models import PhysicalModel as PhysicalModel
from truearm.compensation.models.model_file import load_model as load_model
from truearm.errors import InputError as InputError
from truearm.identification.virtual import VirtualArm as VirtualArm
from truearm.readings import Lengths as Lengths
from truearm.readings import Session as Session
from truearm.readings import import_table as import_table
from truearm.readings import read_lengths as read_lengths
from truearm.readings import read_session as read_session
from truearm.workflows.evaluate import Evaluation as Evaluation
from truearm.workflows.evaluate import evaluate as evaluate
from truearm.workflows.fetch import PublishedReadings as PublishedReadings
from truearm.workflows.fetch import fetch as fetch
from truearm.workflows.fit import FitResult as FitResult
from truearm.workflows.fit import fit as fit
from truearm.workflows.predict import Prediction as Prediction
from truearm.workflows.predict import predict as predict
from truearm.workflows.refit import RefitResult as RefitResult
from truearm.workflows.refit import refit as refit
from truearm.workflows.simulate import SimulationResult as SimulationResult
from truearm.workflows.simulate import simulate as simulate

__version__: str
