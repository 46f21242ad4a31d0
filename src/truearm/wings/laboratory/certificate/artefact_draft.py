"""A file of artefacts from the certificate of one: what the certificate states is filled in, the rest is named.

Which quantity is the diameter, a length, or the form deviation stands in names and reference types, in several
languages. Where they do not say it, or more than one fits, the person is asked.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal

from truearm.errors import InputError
from truearm.files.toml_documents import toml_text
from truearm.wings.laboratory.certificate.calibration_certificate import CalibrationCertificate, Column, ResultTable
from truearm.wings.laboratory.certificate.dsi_quantities import MeasuredValue
from truearm.wings.laboratory.standards.artefacts import template

ROLES = ("diameter", "length", "form")
REFERENCE_DEGC = Decimal(20)
# The first that is found in a name or a reference type counts.
_KINDS = {
    "uncertainty": "uncertainty(?!.*value)|unsicherheit|incertitude|incertidumbre",
    "limit": "limit|tolerance|toleranz|grenz",
    "form": r"form ?(dev|err|abw)|_form|roundness|rundheit|circularit|spheric|flatness|ebenheit|variation in length"
    "|abweichungsspanne",
    "deviation": "deviation|abweichung|error|[eé]cart|desviaci",
    "nominal": "nominal|nenn",
}
_ROLES = {
    "diameter": "diam|durchmesser",
    "length": r"(?<!wave)length|(?<!wellen)l(ä|ae)nge|distan[cz]|abstand|longueur|longitud|lunghezza|spacing",
    "radius": r"radius|radii|halbmesser|\brayon|\bradio\b|raggio",
}
# Kinds that are no size of an artefact, in words.
_WHY_NOT = {
    "uncertainty": "an uncertainty",
    "limit": "a limit",
    "nominal": "a nominal value",
    "deviation": "a deviation, whose nominal value does not stand beside it",
    "radius": "a radius: the diameter and its uncertainty are twice as large",
}
_NO_LENGTH, _NONE = "which is no unit of length of the D-SI", "none in units of length"
_BAR = "bar|stab|plate|platte|block|endma|cale|step gauge|length|l(ä|ae)nge"
_SPHERE = "sphere|ball|kugel|sphère|bille|esfera"
_REFERENCE = (
    "(reference|referenz|bezugs|référence|referencia).{0,5}temperatur|temp.{0,12}(reference|référence|referencia)"
)
_TEMPLATE_LINE = re.compile(r"(?:# )?(\w+) = (.*?)(?:  # (.*))?")


@dataclass(frozen=True)
class StatedSize:
    """A value in mm of a certificate, `role` what it is of the artefact or None, `path` the names above it."""

    role: str | None
    path: str
    names: tuple[str, ...]
    number: int | None
    mm: Decimal
    u_mm: Decimal | None
    nominal_mm: Decimal | None
    label: str | None
    source: MeasuredValue

    @property
    def name(self) -> str:
        """The path, and which of its values it is."""
        return self.path if self.number is None else f"{self.path} [{self.number}]"

    @property
    def length_name(self) -> str:
        """The name of a length: its nominal value, else its label, else the whole millimetres of its value."""
        if self.nominal_mm is not None:
            return f"{self.nominal_mm.normalize():f}"
        return self.label or f"{self.mm:.0f}"

    def is_called(self, wanted: str) -> bool:
        """Whether a person means it by a name."""
        known = (self.path, self.name, *self.names)
        return wanted.casefold() in (one.casefold() for one in known)

    def describe_u(self) -> str:
        """Where the standard uncertainty comes from."""
        if self.source.standard is not None:
            return f"standard uncertainty {self.source.standard} {self.source.unit}"
        return f"U = {self.source.expanded} {self.source.unit} divided by k = {self.source.factor}"


@dataclass(frozen=True)
class ArtefactDraft:
    """A file of artefacts to complete.

    Attributes
    ----------
    kind : {"sphere", "bar"}
    text : str
        The file, TOML.
    filled, missing : tuple of str
        Keys that are filled in from the certificate, and required ones that are not.
    remarks : tuple of str
        What was assumed, and what was not used.
    """

    kind: str
    text: str
    filled: tuple[str, ...]
    missing: tuple[str, ...]
    remarks: tuple[str, ...]


def draft_artefact(
    certificate: CalibrationCertificate, *, chosen: Mapping[str, str] | None = None, header: Iterable[str] = ()
) -> ArtefactDraft:
    """Fill in a file of artefacts from the certificate of a sphere, a bar, a ball bar or gauge blocks.

    Parameters
    ----------
    certificate : CalibrationCertificate
    chosen : mapping of str to str, optional
        For "diameter", "length" and "form" the name of the result that is meant.
    header : iterable of str
        Lines to begin the file with, as comments.

    Raises
    ------
    InputError
        If it states no such result, or several and it is not chosen which.
    """
    chosen = chosen or {}
    sizes = tuple(size for table in certificate.results for size in _sizes(table))
    untaken = _not_taken(certificate, sizes)
    _check_some_size(sizes, untaken, chosen)
    kind, used, assumed = _choose(certificate, sizes, chosen)
    forms = _meant("form", sizes, chosen) if "form" in chosen else [one for one in sizes if one.role == "form"]
    values = _known(certificate)
    if forms:
        form = max(forms, key=lambda one: one.mm)
        values |= _entry("form_mm", "u_form_mm", form)
        if len(forms) > 1:
            assumed.append(f"form_mm is the largest of {len(forms)} form deviations: {form.name}.")
    values |= _size_entries(kind, used)
    references = _reference_temperatures(certificate)
    if not references:
        assumed.append(
            "The certificate states no reference temperature: its lengths are taken to be at 20 degC (ISO 1)."
        )
    elif references != {REFERENCE_DEGC}:
        keys = [key for key in values if key.startswith(("diameter", "u_diameter", "lengths"))]
        values = {key: value for key, value in values.items() if key not in keys}
        away = " or ".join(map(str, sorted(references)))
        at = f"L / (1 + expansion_per_K * ({away if len(references) == 1 else 'T'} - 20))"
        held = ", ".join(f"{one.name}: {one.mm:f} mm" for one in used)
        assumed.append(f"The lengths hold at {away} degC, not at 20 degC; enter {at} for {held}.")
    beside = [f"{one.name}, {one.mm:f} mm" for one in sizes if one not in used and one not in forms]
    beside += [one for one in untaken.values() if one.endswith(_WHY_NOT["radius"])]
    if beside:
        assumed.append(f"Not used: {'; '.join(beside[:20])}.")
    lines = list(_table_lines(f"{kind}s", values))
    text = "\n".join([*(f"# {line}" for line in (*header, *assumed)), "", *lines, ""])
    filled = tuple(key for line in lines if (key := line.partition(" = ")[0]) in values)
    missing = tuple(line.partition(" = ")[0][2:] for line in lines if line.startswith("# ") and _NOT in line)
    return ArtefactDraft(kind, text, filled, missing, tuple(assumed))


_NOT = "not in the certificate: "


def _sizes(table: ResultTable) -> Iterator[StatedSize]:
    """The sizes of a table: values in metres, or deviations from nominal ones beside them."""
    columns = [(column, _kind(table, column)) for column in table.columns if _in_mm(column) is not None]
    nominal = next((_in_mm(column) for column, kind in columns if kind == "nominal"), None)
    absolute = any(kind is None for _, kind in columns)
    labels = next((column.texts for column in table.columns if column.texts), ())
    for column, kind in columns:
        values = _in_mm(column)
        assert values is not None
        if kind in _WHY_NOT and not (kind == "deviation" and nominal is not None and not absolute):
            continue
        role = "form" if kind == "form" else _role(table, column)
        beside = nominal if nominal is not None and len(nominal) == len(values) else [None] * len(values)
        for number, (mm, of_nominal, source) in enumerate(zip(values, beside, column.values, strict=True), start=1):
            if kind == "deviation" and of_nominal is None:
                raise InputError(f"{table.path(column)}: {len(values)} deviations, {len(nominal or [])} nominal values")
            scale = _scale(source)
            u = source.u
            if (u is not None and u < 0) or (source.factor is not None and source.factor <= 0):
                raise InputError(f"{table.path(column)}: the uncertainty or its coverage factor is not positive")
            yield StatedSize(
                role=role,
                path=table.path(column),
                names=tuple(one.name for one in (*table.headings, column.heading) if one.name),
                number=number if len(values) > 1 else None,
                mm=mm + (of_nominal or Decimal(0)) if kind == "deviation" else mm,
                u_mm=None if u is None else u.scaleb(scale),
                nominal_mm=None if kind == "form" else of_nominal,
                label=source.label or (labels[number - 1] if len(labels) == len(values) else None),
                source=source,
            )


def _scale(value: MeasuredValue) -> int:
    exponent = value.scale_to({"metre": 1})
    assert exponent is not None
    return exponent + 3


def _in_mm(column: Column) -> list[Decimal] | None:
    """The values of a column in mm; None if one of them is no length, or there are none."""
    if not column.values or any(one.scale_to({"metre": 1}) is None for one in column.values):
        return None
    return [one.value.scaleb(_scale(one)) for one in column.values]


def _found(patterns: Mapping[str, str], words: str) -> str | None:
    return next((name for name, pattern in patterns.items() if re.search(pattern, words)), None)


def _kind(table: ResultTable, column: Column) -> str | None:
    """Whether a column is an uncertainty, a limit, a form deviation, a deviation, nominal or a radius; None: a size."""
    return _found(_KINDS, column.heading.words) or ("radius" if _role(table, column) == "radius" else None)


def _role(table: ResultTable, column: Column) -> str | None:
    """What a column is of the artefact, by its own name or by the nearest heading that says it."""
    for heading in (column.heading, *reversed(table.headings)):
        if _found({"form": _KINDS["form"]}, heading.words):
            return "form"
        if (role := _found(_ROLES, heading.words)) is not None:
            return role
    return None


def _choose(
    certificate: CalibrationCertificate, sizes: tuple[StatedSize, ...], chosen: Mapping[str, str]
) -> tuple[str, list[StatedSize], list[str]]:
    """The kind of the artefact, its sizes, and what was assumed."""
    if unknown := [role for role in chosen if role not in ROLES]:
        raise InputError(f"expected {', '.join(ROLES)}, got {unknown[0]!r}", hint="--result 'diameter=NAME'")
    if "diameter" in chosen and "length" in chosen:
        raise InputError("an artefact is a sphere or a bar", hint="choose a diameter or a length, in two runs for both")
    item = " ".join(one.heading.words for one in certificate.items)
    looks = "bar" if re.search(_BAR, item) else "sphere" if re.search(_SPHERE, item) else None
    by = {role: [one for one in sizes if one.role == role] for role in (*ROLES, None)}
    assumed: list[str] = []
    if "diameter" in chosen or "length" in chosen:
        role = "diameter" if "diameter" in chosen else "length"
        used = _meant(role, sizes, chosen)
    elif by["diameter"] and by["length"] and looks is None:
        raise _asked("the certificate states diameters and lengths", [*by["diameter"], *by["length"]])
    elif by["length"] and not (by["diameter"] and looks == "sphere"):
        role, used = "length", by["length"]
    elif by["diameter"]:
        role, used = "diameter", by["diameter"]
    elif looks is not None and by[None]:
        role, used = ("length" if looks == "bar" else "diameter"), by[None]
        assumed.append(f"{used[0].path} is taken for the {role}: the item is {certificate.items[0].heading.name!r}.")
    else:
        raise _asked("the certificate does not say which result is the diameter or the length", list(sizes))
    if role == "diameter" and len(used) > 1:
        raise _asked(f"the certificate states {len(used)} diameters", used)
    names = [one.length_name for one in used]
    if role == "length" and (twice := next((name for name in names if names.count(name) > 1), None)) is not None:
        raise _asked(f"the certificate states the length {twice} more than once", used)
    if wrong := [one for one in used if one.mm <= 0]:
        raise InputError(f"{wrong[0].name}: expected a positive length, got {wrong[0].mm:f} mm")
    return ("sphere" if role == "diameter" else "bar"), list(used), assumed


def _meant(role: str, sizes: Iterable[StatedSize], chosen: Mapping[str, str]) -> list[StatedSize]:
    """The sizes that a person has chosen for a role."""
    sizes = list(sizes)
    if found := [one for one in sizes if one.is_called(chosen[role])]:
        return found
    raise _asked(f"the certificate has no result in units of length that is called {chosen[role]!r}", sizes, role)


def _asked(problem: str, sizes: list[StatedSize], role: str | None = None) -> InputError:
    listed = "; ".join(f"{one.name!r}, {one.mm:f} mm" for one in sizes[:20])
    role = role or next((one.role for one in sizes if one.role), "diameter")
    return InputError(f"{problem}; its results are {listed}", hint=f"choose one: --result '{role}={sizes[0].name}'")


def _check_some_size(sizes: Sequence[StatedSize], untaken: Mapping[str, str], chosen: Mapping[str, str]) -> None:
    """Refuse a certificate without a diameter or a length, or the choice of a result that is none."""
    names = [f" / {name}".casefold() for name in chosen.values()]
    meant = [text for path, text in untaken.items() if f" / {path}".casefold().endswith(tuple(names))]
    if sizes and not meant and ("diameter" in chosen or "length" in chosen or any(one.role != "form" for one in sizes)):
        return
    listed = "; ".join([*(meant or untaken.values())][:20])
    what = "no diameter and no length" if any(_NO_LENGTH not in one for one in untaken.values()) else _NONE
    problem = (
        "not taken"
        if meant
        else f"the certificate does not say which result is the diameter or the length; its results are {what}"
    )
    raise InputError(
        f"{problem}: {listed}" if listed else problem,
        hint="enter diameter or lengths in mm in the empty file that truearm verify template artefacts prints",
    )


def _not_taken(certificate: CalibrationCertificate, sizes: Iterable[StatedSize]) -> dict[str, str]:
    """The results that are no size of an artefact, by their names: each with its unit and the reason."""
    taken = {one.path for one in sizes}
    said = {}
    for table in certificate.results:
        for column in table.columns:
            path = table.path(column)
            if column.values and path not in taken:
                kind = None if _in_mm(column) is None else _kind(table, column)
                said[path] = f"{path!r} in {column.values[0].unit}, {_WHY_NOT.get(kind or '', _NO_LENGTH)}"
    return said


def _known(certificate: CalibrationCertificate) -> dict[str, tuple[str, str]]:
    """What is known of the certificate itself, by key: its TOML and where it comes from."""
    item = certificate.items[0] if certificate.items else None
    code, serial = certificate.laboratory_code, _serial(certificate)
    texts = {
        "name": (item and item.heading.name, "the item; write it as in the file of points"),
        "certificate": (certificate.number, "its number"),
        "issued_by": (certificate.laboratory, "the laboratory"),
        "issuer_accreditation": (code, "of the laboratory"),
        "serial_number": (serial, "of the item"),
    }
    days = {
        "date": (certificate.end, "last day of the calibration"),
        "expires": (certificate.next_calibration, "the day by which it shall be calibrated again"),
    }
    known = {key: (toml_text(text[:200]), source) for key, (text, source) in texts.items() if text}
    known |= {key: (day.isoformat(), source) for key, (day, source) in days.items() if day is not None}
    tables = (*certificate.results, *certificate.conditions)
    expansions = [
        (table.path(column), one, scale)
        for table in tables
        for column in table.columns
        for one in column.values
        if (scale := _expansion_scale(one)) is not None
    ]
    if len(expansions) == 1:
        path, one, scale = expansions[0]
        known["expansion_per_K"] = (_power(one.value.scaleb(scale)), path)
        if one.u is not None:
            known["u_expansion_per_K"] = (_power(_short(one.u.scaleb(scale))), path)
    return known


def _serial(certificate: CalibrationCertificate) -> str | None:
    numbers = [number for item in certificate.items[:1] for number in item.numbers]
    return next((value for issuer, value in numbers if issuer == "manufacturer"), numbers[0][1] if numbers else None)


def _expansion_scale(value: MeasuredValue) -> int | None:
    kelvin = value.scale_to({"kelvin": -1})
    return value.scale_to({"degreecelsius": -1}) if kelvin is None else kelvin


def _entry(key: str, u_key: str, size: StatedSize) -> dict[str, tuple[str, str]]:
    entry = {key: (_toml(size.mm), size.name)}
    if size.u_mm is not None:
        entry[u_key] = (_toml(_short(size.u_mm)), size.describe_u())
    return entry


def _size_entries(kind: str, used: list[StatedSize]) -> dict[str, tuple[str, str]]:
    if kind == "sphere":
        (size,) = used
        nominal = {} if size.nominal_mm is None else {"nominal_mm": (_toml(size.nominal_mm), "nominal")}
        return _entry("diameter_mm", "u_diameter_mm", size) | nominal
    lines = []
    for one in used:
        nominal_part = "" if one.nominal_mm is None else f"nominal_mm = {_toml(one.nominal_mm)}, "
        if one.u_mm is None:
            lines.append(
                f"  # {{ name = {toml_text(one.length_name)}, length_mm = {_toml(one.mm)}, u_mm = nan }},  # {_NOT}U"
            )
            continue
        parts = f"length_mm = {_toml(one.mm)}, u_mm = {_toml(_short(one.u_mm))}"
        lines.append(
            f"  {{ name = {toml_text(one.length_name)}, {nominal_part}{parts} }},  # {one.name}, {one.describe_u()}"
        )
    return {"lengths": ("\n".join(["[", *lines, "]"]), "")}


def _reference_temperatures(certificate: CalibrationCertificate) -> set[Decimal]:
    """The reference temperatures [degC] that the certificate states."""
    found = set[Decimal]()
    for table in (*certificate.conditions, *certificate.results):
        for column in table.columns:
            words = " ".join(one.words for one in (*table.headings, column.heading))
            for one in column.values if re.search(_REFERENCE, words) else ():
                if (kelvin := one.scale_to({"kelvin": 1})) is not None:
                    found.add(one.value.scaleb(kelvin) - Decimal("273.15"))
                elif (degC := one.scale_to({"degreecelsius": 1})) is not None:
                    found.add(one.value.scaleb(degC))
    return found


def _table_lines(table: str, values: Mapping[str, tuple[str, str]]) -> Iterator[str]:
    """The lines of a table of the empty file of artefacts, filled in; what is not known stays a comment."""
    empty_file = re.sub(
        r"lengths = \[.*?\n\]", "lengths = []  # the calibrated ones", template("artefacts"), flags=re.DOTALL
    )
    tables = {part.partition("]]")[0]: part.splitlines() for part in empty_file.split("\n[[")[1:]}
    read = {name: [one for line in lines if (one := _TEMPLATE_LINE.fullmatch(line))] for name, lines in tables.items()}
    meanings = {one[1]: one[3] for lines in reversed(read.values()) for one in lines if one[3]}
    yield f"[[{table}]]"
    for one in read[table]:
        key, empty = one[1], one[2]
        if key in values:
            text, source = values[key]
            yield f"{key} = {text}  # {source}" if source else f"{key} = {text}"
        elif one[0].startswith("#"):
            yield one[0]
        else:
            yield f"# {key} = {empty}  # {_NOT}{meanings.get(key, 'fill it in')}"


def _short(value: Decimal) -> Decimal:
    """To three significant digits."""
    return Decimal(f"{value:.3g}")


def _power(value: Decimal) -> str:
    return f"{value.normalize():e}"


def _toml(value: Decimal) -> str:
    """A float of TOML with the written digits."""
    text = f"{value:f}"
    return text if "." in text else f"{text}.0"
