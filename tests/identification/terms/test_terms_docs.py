"""The page about terms says what the program does."""

import json
from pathlib import Path

from page_transcripts import blocks
from truearm.identification.terms import Term, basis, catalogue
from truearm.identification.terms.expression import INPUTS

PAGE = Path(__file__).parents[3] / "docs" / "terms.md"


def test_its_example_runs_and_gives_what_it_states():
    names: dict = {"__name__": "example"}
    for text in blocks("terms.md", "python"):
        exec(text, names)
    belt, cable, state = names["belt"], names["cable"], names["state"]
    assert names["not_offered"][0].reason == "the readings have no temperature"
    assert cable.basis.values(state).shape == (2, 500)
    assert cable.as_data()["basis"] == {"kind": "Winding", "joint": 6}
    assert names["terms"][-2:] == [belt, cable]
    for term in (belt, cable):
        assert Term.from_data(json.loads(json.dumps(term.as_data()))) == term


def test_every_registered_basis_and_every_input_of_expressions_is_on_the_page():
    text = PAGE.read_text(encoding="utf-8")
    ours = [name for name, kind in basis._KINDS.items() if kind.__module__.startswith("truearm.")]
    assert [name for name in ours if f"`{name}(" not in text] == []
    assert [kind for kind in INPUTS if f"`{kind.replace(' ', '_')}(" not in text] == []


def test_every_kind_of_term_and_its_groups_are_in_the_table(make_chain):
    chain, text = make_chain(sliding=True), PAGE.read_text(encoding="utf-8")
    made = {
        "constants": catalogue.constants(chain),
        "wobble": catalogue.wobble(chain, 1),
        "gravity": catalogue.gravity(chain, 1),
        "thermal": catalogue.thermal(chain),
        "hysteresis": catalogue.hysteresis(chain, 1) + catalogue.hysteresis(chain, 3),
    }
    for name, terms in made.items():
        (row,) = [line for line in text.splitlines() if line.startswith(f"| `{name}`")]
        for term in terms:
            assert f'"{term.group}"' in row
            assert f"`{type(term.basis).__name__}(" in row
    for other in ("own_axis", "column"):
        assert f"| `{other}`" in text
