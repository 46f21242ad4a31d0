"""Laws of `import truearm`: it is quick, lists every name, and every name is documented with an example that runs."""

import ast
import doctest
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import truearm as ta
from truearm.verbs.record import Record

PACKAGE = Path(ta.__file__).parent
NAMES = [name for name in ta.__all__ if name not in ("__version__", "datasets", "shapes")]
HEAVY = {"numpy", "scipy", "pandas", "sklearn", "matplotlib", "pydantic", "jinja2", "pooch", "typer", "rich"}


def test_the_import_loads_no_heavy_package():
    ran = subprocess.run(
        [sys.executable, "-c", "import truearm, sys; dir(truearm); print(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert not HEAVY & set(ran.stdout.split())


def test_a_certificate_loads_no_plotting():
    ran = subprocess.run(
        [sys.executable, "-c", "import truearm, sys; truearm.certificate; print(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "matplotlib" not in ran.stdout.split()


def test_every_name_is_listed_and_loads():
    assert sorted(dir(ta)) == sorted(ta.__all__)
    for name in ta.__all__:
        assert getattr(ta, name) is not None


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'calibrate'"):
        ta.calibrate  # noqa: B018


def test_a_former_name_leads_to_the_present_one():
    with pytest.warns(DeprecationWarning, match="truearm.fit_large is truearm.fit now"):
        assert ta.fit_large is ta.fit


@pytest.mark.parametrize("verb", ["fit", "evaluate", "predict"])
def test_a_former_name_says_where_its_attributes_are(verb, ur10_session, ur10_model, tmp_path):
    (tmp_path / "line").mkdir()
    ur10_session.save(tmp_path / "line" / "1.csv")
    with pytest.warns(DeprecationWarning, match=f"truearm.{verb}_large is truearm.{verb} now: ") as caught:
        former = getattr(ta, f"{verb}_large")
    said, folder = str(caught[0].message), tmp_path / "line"
    if verb == "fit":
        found = former("ur10", folder, model="kinematic")
        assert "n_passes, total, effect and n_effective are in all_readings" in said
        assert "of_sample is all_readings.why_of_sample" in said
        every = found.all_readings
        assert (every.n_passes, every.total.sums.n, every.why_of_sample) == (2, 60, "")
        assert every.effect.factor == pytest.approx(60 / every.n_effective)
        assert found.of_sample.n_readings == 60
    elif verb == "evaluate":
        found = former(ur10_model, folder)
        assert "sums.errors is sums.points" in said
        assert "n_covered, n_covered_99, variance, n_outliers, outliers and outliers_of_file" in said
        assert "of sums are in sums.applies" in said
        applies = found.sums.applies
        for name in ("n_covered", "n_covered_99", "variance", "n_outliers", "outliers", "outliers_of_file"):
            assert hasattr(applies, name)
        assert found.sums.points["model"].n == 60
        assert found.remarks
    else:
        found = former(ur10_model, folder, tmp_path / "points.csv")
        assert "sums.n_points is sums.n, sums.unstated is unstated_u_mm, and sums.remarks is remarks" in said
        assert (found.sums.n, found.unstated_u_mm, found.remarks) == (60, {}, ())


def test_type_checkers_see_the_same_names():
    """`__init__.pyi` beside the lazy module."""
    stub = ast.parse((PACKAGE / "__init__.pyi").read_text(encoding="utf-8"))
    seen = {"__version__"}
    for node in stub.body:
        if isinstance(node, ast.ImportFrom):
            seen |= {alias.asname for alias in node.names}
    assert seen == set(ta.__all__)
    for module, names in ta._HOMES.items():
        imported = {
            alias.name
            for node in stub.body
            if isinstance(node, ast.ImportFrom) and node.module == module
            for alias in node.names
        }
        assert imported == set(names), module


def test_no_public_name_hides_a_module():
    """A package attribute cannot be both: `truearm.fit` is the function, and no module has that name."""
    modules = {path.stem for path in PACKAGE.glob("*.py")} | {path.name for path in PACKAGE.iterdir() if path.is_dir()}
    assert not modules & set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_every_name_has_an_example_that_runs(name, tmp_path, monkeypatch):
    """A record may leave it to the verb that returns it."""
    monkeypatch.chdir(tmp_path)
    if name in ("find_corners", "simulate_images"):
        pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'truearm[camera]'")
    thing = getattr(ta, name)
    text, verb = inspect.getdoc(thing) or "", thing.__module__.rpartition(".")[2]
    if "Examples\n" not in text and inspect.isclass(thing) and issubclass(thing, Record):
        assert verb in NAMES
        return
    names = {**vars(sys.modules[thing.__module__]), "ta": ta}
    example = doctest.DocTestParser().get_doctest(text, names, name, None, None)
    assert "Examples\n--------" in text, f"{name} has no Examples section"
    assert example.examples
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL, verbose=False)
    said: list[str] = []
    runner.run(example, out=said.append)
    assert runner.failures == 0, "".join(said)


def test_records_read_as_text_and_as_html_and_as_json():
    """What a record prints is what a notebook shows and what machines get."""
    import json

    session = ta.simulate("ur10", poses=40, seed=1).session
    fitted = ta.fit("ur10", session, model="kinematic")
    for record in (fitted, ta.evaluate(fitted.model, session), ta.predict(fitted.model, session)):
        text, html = str(record), record._repr_html_()
        assert text.splitlines()[0] == record.summary() == record.to_dict()["summary"]
        assert record.summary().split("<")[0] in html.replace("&lt;", "<")
        assert repr(record).startswith(f"<{type(record).__name__}: ")
        json.dumps(record.to_dict(), allow_nan=False)
    assert "<svg" in fitted._repr_html_()
    assert "<table" in ta.evaluate(fitted.model, session)._repr_html_()


# Of all readings as docs/ur10.md prints them, and of each tenth.
CHAINS = {
    1: ((8339, 3572), [0.7577, 0.4136, 0.0580], (0.7497, 0.0569, 0.1231), "0.058 mm on held-out readings, 13 times"),
    10: ((834, 358), [0.7596, 0.4098, 0.0676], (0.7594, 0.0666, 0.1325), "0.068 mm on held-out readings, 11 times"),
}


@pytest.mark.parametrize("every", [pytest.param(1, marks=pytest.mark.weekly), 10])
def test_the_ur10_chain_takes_ten_lines_and_has_the_published_figures(every, tmp_path):
    """Read, split, fit, evaluate and predict measured data with nothing but `ta`."""
    if ta.datasets.find_local("ur10-a") is None:
        pytest.skip("the published readings are not here (TRUEARM_DATA)")
    ta.fetch("ur10-a").save(tmp_path / "ur10.csv")

    arm = ta.load_arm("ur10")
    session = ta.read_session(tmp_path / "ur10.csv")
    train, test = (one.rows(slice(None, None, every)) for one in session.split(by="position", hold_out=0.3, seed=1))
    fit = ta.fit(arm, train)
    evaluation = ta.evaluate(fit.model, test)
    xyz, cov = fit.model.predict(test.angles, return_cov=True)
    prediction = ta.predict(fit.model, test)
    fit.save(tmp_path / "ur10.truearm")

    n, held_out, (nominal, model, p95), said = CHAINS[every]
    assert (len(train), len(test)) == n
    assert [score.name for score in fit.comparison if score.kept] == ["physical"]
    assert [round(score.mean_mm, 4) for score in fit.comparison] == pytest.approx(held_out, abs=2e-4)
    assert evaluation.errors["nominal"]["mean_mm"] == pytest.approx(nominal, abs=2e-4)
    assert evaluation.errors["model"]["mean_mm"] == pytest.approx(model, abs=2e-4)
    assert evaluation.errors["model"]["p95_mm"] == pytest.approx(p95, abs=5e-4)
    assert 0.93 < evaluation.coverage < 0.97
    assert xyz.shape == prediction.points.shape == (n[1], 3)
    assert cov.shape == (n[1], 3, 3)
    assert f"Mean error {said} smaller than the nominal arm" in str(fit)
