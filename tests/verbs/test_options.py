"""Options of the commands: one name is one thing, and what it was called before is answered."""

import importlib
import inspect
import subprocess
import sys
from collections import defaultdict
from inspect import Parameter, signature
from pathlib import Path
from typing import Literal, get_args, get_origin

import pytest
import typer

from command_line import called, declared, functions
from refusals import refuses
from truearm.command_line import OTHER_NAMES
from truearm.models import HybridModel, NetworkModel
from truearm.verbs.commands import MODELS_OF, PARAMETERS
from truearm.verbs.options import KINDS, Source, of_verb, parameters_described

# What an option means where commands say it in their own words.
MEANINGS = {
    "--arms": "number of arms",
    "--bar": "length of a bar between its seats",
    "--by": "what belongs together",
    "--conditions": "conditions of the uncertainty, of an evaluation those of its readings",
    "--epochs": "maximum epochs of a training",
    "--feature": "what is measured",
    "--goal": "error at which a training stops",
    "--hidden": "units of the hidden layers",
    "--noise": "standard deviation of a coordinate",
    "--into": "points to measure that are filled in",
    "--out": "what the command writes",
    "--points": "number of points",
    "--poses": "number of poses",
    "--repeatability": "standard deviation of a coordinate, measured again in the same pose",
    "--seats": "number of seats",
    "--session": "session file, of a fleet also a URL",
    "--strategy": "how poses are chosen",
    "--start": "joints to start from",
    "--tip-diameter": "diameter of the stylus tip",
    "--trainer": "trainer of a network",
}


def kind(types):
    """What is typed: a choice is a text, several are given as one each, a parser may make anything of it."""
    found = {str if isinstance(one, str) or get_origin(one) is Literal else one for one in types}
    (typed,) = {one for one in found if one in (*KINDS.values(), Path)} or {str}
    return typed


def test_one_name_is_one_thing():
    by_name = defaultdict(list)
    for one in declared():
        if one.name.startswith("--"):
            by_name[one.name].append(one)
    for name, all_of_it in by_name.items():
        kinds = {kind(one.types) for one in all_of_it}
        assert len(kinds) == 1 or (name == "--session" and kinds == {Path, str}), name
        assert len({one.help for one in all_of_it}) == 1 or name in MEANINGS, name
    said = {name for name, all_of_it in by_name.items() if len({one.help for one in all_of_it}) > 1}
    assert said == MEANINGS.keys()


def test_every_option_has_a_sentence():
    for one in declared():
        assert one.help.strip(), one
        assert "`" not in one.help.replace("`truearm arms`", ""), one


def test_what_an_option_was_called_is_answered_with_what_it_is_called(truearm):
    known = defaultdict(set)
    for one in declared():
        known[one.command].add(one.name)
    for before, now in OTHER_NAMES.items():
        command, _, option = before.rpartition(" ")
        name = now.partition(" ")[0]
        if ". Try: " in now:
            continue  # a sentence, see below
        if not option.startswith("-"):
            assert now in known
        elif name == "truearm":
            ran = truearm(*command.split(), option, "x")
            assert (ran.code, ran.err) == (2, f"truearm: {option} is a command now. Try: {now}\n")
            assert any(now.startswith(f"truearm {one}") for one in known), now
        else:
            of = (
                [command] if command else [one for one, there in known.items() if name in there and option not in there]
            )
            assert of, before
            for one in of:
                special = OTHER_NAMES.get(f"{one} {option}", now)
                ran = truearm(*one.split(), option, "x")
                assert ran.code == 2
                if not special.startswith("truearm "):
                    said = f"{option} is called {special.partition(' ')[0]} here. Try: truearm {one} {special}"
                    assert ran.err == f"truearm: {said}\n"


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        (["arms", "ur10", "--page"], "arms --page"),
        (["fetch", "--list"], "fetch --list"),
        (["import", "joints.csv", "--images", "pictures"], "import --images"),
        (["simulate", "ur10", "--out", "x.csv", "--reference"], "simulate --reference"),
        (["verify", "sheet", "iso10360-12", "--out", "x.html"], "verify sheet --page"),
    ],
)
def test_what_an_earlier_use_of_an_option_is_answered(truearm, arguments, answer):
    ran = truearm(*arguments)
    assert (ran.code, ran.err) == (2, f"truearm: {OTHER_NAMES[answer]}\n")


def test_every_sentence_about_an_earlier_use_is_tested():
    (mark,) = test_what_an_earlier_use_of_an_option_is_answered.pytestmark
    assert {answer for _, answer in mark.args[1]} == {name for name, now in OTHER_NAMES.items() if ". Try: " in now}


def test_an_option_that_is_missing_is_not_taken_for_one_of_another_name(truearm):
    """--out was the page of some commands."""
    assert truearm("plan", "ur10", "--artefact", "seat").err == (
        "truearm: Missing option '--out'. Try: truearm plan --help\n"
    )
    assert "Option '--out' requires an argument. Try: truearm fit --help" in truearm("fit", "s.csv", "--out").err


def test_numbers_beyond_what_ends_in_time_are_refused_at_once(truearm, refused):
    for option, number in (("--seats", 0), ("--seats", 201), ("--poses", 0), ("--poses", 501)):
        refused(
            ["plan", "ur10", "--artefact", "seat", "--out", "x.csv", option, number],
            f"Invalid value for '{option}': Input should be",
        )
    ran = truearm("import", "x.csv", "--preview", "--skip-lines", -1)
    assert "Invalid value for '--skip-lines': Input should be greater than or equal to 0" in ran.err


def test_a_default_is_in_the_help(truearm):
    """Of every option that has one, unless its sentence says what goes without it."""
    listed = defaultdict(list)
    for command, function in functions():
        for one in signature(function, eval_str=True).parameters.values():
            default = one.default
            has_none = default in ("", (), Parameter.empty) or default is None or default is False
            if one.annotation is typer.Context or has_none:
                continue
            info = get_args(one.annotation)[1]
            if info.show_default:
                listed[command].append(str(default).replace("True", one.name.replace("_", "-")))
            else:
                assert default == Path(), one  # --out of truearm live, which --demo does not need
    for command, defaults in listed.items():
        shown = "".join(truearm(*command.split(), "--help").out.split())
        for default in defaults:
            assert f"[default:{default}" in shown, (command, default)


def test_a_default_of_a_fit_is_that_of_its_model():
    """Its option shows it where the models agree; its sentence says it where they do not."""
    fit = signature(next(one for name, one in functions() if name == "fit"), eval_str=True).parameters
    classes = {"network": NetworkModel, "hybrid": HybridModel}
    for name in ("hidden", "trainer", "epochs", "goal", "validation", "restarts", "members", "seed", "arm_model"):
        of_models = [
            signature(classes[model]).parameters[PARAMETERS.get(name, name)].default for model in MODELS_OF[name]
        ]
        if fit[name].default is None:
            words = " and ".join(",".join(map(str, one)) if isinstance(one, tuple) else str(one) for one in of_models)
            assert f"default {words}." in get_args(fit[name].annotation)[1].help
        else:
            assert set(of_models) == {fit[name].default}


SAFETY = "in which neither arm nor artefact is in any pose; between poses nothing is checked"


@pytest.mark.parametrize(
    ("command", "fact"),
    [
        ("plan", SAFETY),
        ("evaluate", "By default what the column session says."),
        ("fit", "--apply writes the nominal arm with the joint zeros that were found"),
        ("fit", "--free none: points are in the arm's base frame and the tip is known."),
        ("export", "by default in the convention with the nominal arm's numbers, and from the arm's own base."),
        ("fleet add", "--model is by default auto, or as before."),
        ("task", "Without --arm, a preset or a specification is of the arm measuring7."),
        ("verify simulate", "without --arm a preset is of the arm measuring7."),
    ],
)
def test_help_says_what_a_shared_sentence_leaves_open(truearm, command, fact):
    assert fact in " ".join(truearm(*command.split(), "--help").out.split())


def test_no_option_offers_what_its_command_refuses(truearm):
    assert "none" not in next(one.help for one in declared() if (one.command, one.name) == ("refit", "--free"))


def test_what_the_parser_of_an_option_refuses_is_said_once(truearm):
    ran = truearm("fit", "s.csv", "--out", "m.truearm", "--free", "elbow")
    said = "truearm: --free expects base, tip, base,tip or none, got 'elbow'. Try: --free base,tip\n"
    assert (ran.code, ran.err) == (2, said)


def test_the_short_option_of_other_programs_is_answered_by_its_name_here(truearm):
    assert truearm("import", "t.csv", "-o", "s.csv").err == (
        "truearm: -o is called --out here. Try: truearm import --out\n"
    )


def test_an_option_that_never_was_is_answered_by_none(truearm):
    assert "No such option: --spec" in truearm("fit", "--spec", "x").err


Choice = Literal["a", "b"]


def verb(what, *, n_arms: int = 3, size_mm: float | None = None, how: Choice | None = None, fast: bool = True):
    """Do it.

    Parameters
    ----------
    what : str
        Of it.
    n_arms : int
        Number of ``arms``, and
        no more.
    size_mm, how : float, optional
        Both of `it`.
    fast : bool
        Whether.

    Returns
    -------
    None
    """
    return what, n_arms, size_mm, how, fast


def test_a_command_has_the_options_of_its_verb():
    assert parameters_described(inspect.getdoc(verb)) == {
        "what": "Of it.",
        "n_arms": "Number of arms, and no more.",
        "size_mm": "Both of it.",
        "how": "Both of it.",
        "fast": "Whether.",
    }
    found = []

    def command(verb, what: str, as_json: bool = False, **given: object) -> None:
        found.append(verb(what, **given))

    complete = of_verb(f"{__name__}:verb", within={"n_arms": (1, 9)})(command).with_options()
    options = {name: one.annotation for name, one in signature(complete).parameters.items()}
    assert list(options) == ["what", "n_arms", "size_mm", "how", "fast", "as_json"]
    names = {name: get_args(options[name])[1].default for name in ("n_arms", "size_mm", "how", "fast")}
    assert names == {"n_arms": "--arms", "size_mm": "--size", "how": "--how", "fast": "--fast/--no-fast"}
    assert get_args(options["n_arms"])[1].max == 9
    assert all(one.kind is Parameter.KEYWORD_ONLY for one in signature(complete).parameters.values())
    complete(what="x", n_arms=4, size_mm=None, how="a", fast=False)
    assert found == [("x", 4, None, "a", False)]


def test_the_options_of_a_verb_are_those_of_its_signature():
    """The source says what the function has."""
    for place in ("truearm.verbs.refit:refit", "truearm.wings.importing.foreign.tables:import_table"):
        module, _, name = place.partition(":")
        read = {one.name: one.default for one in Source.of(module, name).parameters()}
        known = signature(getattr(importlib.import_module(module), name)).parameters.values()
        assert read == {one.name: one.default for one in known if one.default is not Parameter.empty}


def test_help_comes_without_the_heavy_packages():
    """Of any of these commands: one program prints them all."""
    commands = ("fit", "measure", "compare", "simulate")
    listed = (
        f"import sys, truearm.command_line as m\nfor command in {commands}:\n try:\n  m.run([command, '--help'])\n"
        " except SystemExit:\n  pass\nprint(*sys.modules)"
    )
    ran = subprocess.run([sys.executable, "-c", listed], capture_output=True, text=True, check=True)
    assert ran.stdout.count("--json") >= len(commands)
    assert all(f"Usage: truearm {command}" in ran.stdout for command in commands)
    assert not {"numpy", "scipy", "pandas", "sklearn", "matplotlib"} & set(ran.stdout.splitlines()[-1].split())


def test_a_command_refuses_what_its_verb_refuses():
    refuses("expected 1 to 100000 virtual arms, got 0", called, "verify", "simulate", "shop", arms=0)
