"""Sessions of any make: a model is fitted and sound, or the session is refused; nothing warns, nothing crashes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearm.arm import load_arm
from truearm.errors import InputError
from truearm.models import KinematicModel, NominalModel, PhysicalModel
from truearm.models.model_file import load_model
from truearm.readings import Lengths, Session

ARM = load_arm("gao2017")


def session(rng: np.random.Generator) -> tuple[Session, Lengths | None]:
    """Readings with references of some kinds, none, or odd ones: joints at rest, poses twice, names at random."""
    n = int(rng.integers(1, 40))
    angles = ARM.working + rng.choice([0, 1e-3, 0.5, 3]) * rng.uniform(-1, 1, (n, 6))
    if rng.random() < 0.3:
        angles = angles[rng.integers(0, n, n)]
    given: dict = {}
    if rng.random() < 0.6:
        points = ARM.chain.tip_in_base(angles) + rng.choice([0, 0.01, 1, 300]) * rng.normal(size=(n, 3))
        points[rng.random(n) < rng.choice([0, 0.3, 0.9])] = np.nan
        given["points"] = points
        if rng.random() < 0.3:
            given["point_std"] = np.where(np.isnan(points), np.nan, rng.choice([1e-4, 0.01, 5], (n, 1)))
    for name in ("seat", "sphere", "plane", "line", "position"):
        if rng.random() < 0.4:
            given[name] = np.array(rng.choice(["", "a", "b", "c"][: int(rng.integers(1, 5))], n))
    if rng.random() < 0.2:
        quaternion = rng.normal(size=(n, 4))
        quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
        quaternion[rng.random(n) < 0.5] = np.nan
        given["quaternion"] = quaternion
    if rng.random() < 0.3:
        given["temperature_degC"] = 20 + rng.choice([0, 5]) * rng.normal(size=n)
    if rng.random() < 0.3:
        given["columns"] = {"load_2_Nm": rng.choice([0, 1, 1e6]) * rng.normal(size=n)}
    if rng.random() < 0.3:
        given["directions"] = rng.choice([-1, 0, 1], (n, 6))
    if rng.random() < 0.3:
        given["session"] = np.array(rng.choice(["", "May", "June", "July"][int(rng.integers(0, 2)) :], n))
    lengths = None
    if "seat" in given and rng.random() < 0.5:
        length, u = float(rng.choice([1e-3, 300, 1e5])), float(rng.choice([1e-6, 0.01, 10]))
        lengths = Lengths(np.array(["a"]), np.array(["b"]), np.array([length]), np.array([u]))
    return Session(angles, **given), lengths


@pytest.mark.parametrize("examples", [4, pytest.param(40, marks=pytest.mark.weekly)])
@pytest.mark.parametrize(
    "kind", [*(pytest.param(one, marks=pytest.mark.weekly) for one in (NominalModel, KinematicModel)), PhysicalModel]
)
def test_a_session_is_learned_from_or_refused(kind, examples, tmp_path):
    @settings(max_examples=examples)
    @given(st.integers(0, 2**32), st.sampled_from([(), ("base",), ("tip",), ("base", "tip")]))
    def law(seed, free):
        readings, lengths = session(np.random.default_rng(seed))
        model = kind(ARM, free=free, **({"highest": 2} if kind is PhysicalModel else {}))
        try:
            model.fit_readings(readings, lengths=lengths)
        except InputError:
            return
        points, covariance = model.predict_readings(readings, return_cov=True)
        assert np.isfinite(points).all()
        variances = np.linalg.eigvalsh(covariance)
        # mm^2: a tenth of a micron squared is what rounding leaves beside priors of ten metres.
        assert (variances > -1e-8 - 1e-9 * variances.max()).all()
        assert model.residual_std_ > 0
        assert np.isfinite(model.held_out_.deviations).all()
        model.save(tmp_path / "m")
        np.testing.assert_array_equal(load_model(tmp_path / "m").predict_readings(readings), points)

    law()
