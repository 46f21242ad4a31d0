"""The page about networks: its code runs, and what it states is so."""

import inspect
import re
from pathlib import Path

import numpy as np
import pytest

from page_transcripts import blocks
from truearm.models import NetworkModel
from truearm.models.network import TRAINERS
from truearm.nets.levenberg_marquardt import train_varpro
from truearm.nets.normal_equations import FitProblem
from truearm.nets.perceptron import Perceptron, nguyen_widrow

PAGE = Path(__file__).parents[2] / "docs" / "networks.md"


@pytest.fixture(scope="module")
def names(tmp_path_factory) -> dict:
    """What the page's blocks define, run one after the other in a folder of their own."""
    names: dict = {"print": lambda *values: None}
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("networks")
        patch.chdir(folder)
        for text in blocks("networks.md", "python"):
            exec(text, names)
        names["left"] = sorted(path.name for path in folder.iterdir())
    return names


def test_its_code_runs_and_learns(names):
    assert np.abs(names["points"] - names["test"].points).mean() < 5  # mm
    assert np.abs(names["y"] - np.sin(5 * names["x"])).mean() < 0.05
    assert names["left"] == []  # nothing is written that no one asked for


def test_what_it_states_of_tensors_is_so():
    torch = pytest.importorskip("torch", reason="PyTorch is an extra: pip install 'truearm[torch]'")
    scaled = 2 * torch.rand(6, 1000, dtype=torch.float64) - 1
    net = Perceptron.with_layers(6, (12,), 1)
    problem = FitProblem(net, scaled, torch.sin(scaled.sum(dim=0, keepdim=True)))
    weights, record = train_varpro(problem, nguyen_widrow(net, seed=0), epochs=20)
    assert isinstance(weights, np.ndarray)
    assert record.perf[-1] < record.perf[0] / 100


@pytest.mark.weekly
def test_what_it_states_of_an_ensemble_is_so(names):
    inside, outside = names["test"], names["measured"]("measuring", 200, 3)  # everyday poses, far outside the box

    def share(model, readings):
        points, covariance = model.predict(readings.angles, return_cov=True)
        sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        return np.mean(np.abs(points - readings.points) < 2 * sigma)

    one, five = (
        NetworkModel(names["nominal"], hidden=(12,), epochs=60, free=(), n_members=n).fit_readings(names["readings"])
        for n in (1, 5)
    )
    for model in (one, five):
        assert 0.9 < share(model, inside) < 1
        assert 40 < np.median(np.abs(model.predict(outside.angles) - outside.points)) < 300  # mm
    # Which weights a training ends with depends on rounding: only bounds can be stated.
    assert share(one, outside) < 0.15
    assert share(five, outside) > 0.6


def test_the_same_readings_are_validated_as_it_says(names):
    from truearm.nets.training import dividerand

    model, readings = names["model"], names["readings"]
    _, aside, _ = dividerand(len(readings), train=0.85, validation=0.15, test=0, seed=1)
    errors = model.point_scale_.scale(readings.points[aside].T) - model.point_scale_.scale(
        model.predict(readings.angles[aside]).T
    )
    np.testing.assert_allclose(np.mean(errors**2), model.record_.vperf[model.record_.best_epoch], rtol=1e-9)


def test_every_option_and_trainer_stands_in_its_tables():
    text = PAGE.read_text(encoding="utf-8")
    known = set(inspect.signature(NetworkModel).parameters) - {"arm", "free"}
    assert known == set(re.findall(r"^\| `(\w+)` \| (?:`--\w+`)? *\|", text, flags=re.MULTILINE))
    for trainer in TRAINERS:
        assert f"| `{trainer}` |" in text
