"""Certificates of made-up laboratories, written by hand in the forms of DCC 3.1, 3.2 and 3.3 with D-SI 2.1 and 2.2."""

HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<dcc:digitalCalibrationCertificate xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns:dcc="https://ptb.de/dcc"
  xmlns:si="https://ptb.de/si" xsi:schemaLocation="https://ptb.de/dcc https://ptb.de/dcc/v{version}/dcc.xsd"
  schemaVersion="{version}">
<dcc:administrativeData>
<dcc:dccSoftware><dcc:software>
  <dcc:name><dcc:content>Example Editor</dcc:content></dcc:name><dcc:release>v1</dcc:release>
</dcc:software></dcc:dccSoftware>
<dcc:coreData>
  <dcc:countryCodeISO3166_1>DE</dcc:countryCodeISO3166_1>
  <dcc:usedLangCodeISO639_1>de</dcc:usedLangCodeISO639_1><dcc:usedLangCodeISO639_1>en</dcc:usedLangCodeISO639_1>
  <dcc:mandatoryLangCodeISO639_1>de</dcc:mandatoryLangCodeISO639_1>
  <dcc:uniqueIdentifier>1234 EX 26</dcc:uniqueIdentifier>
  <dcc:beginPerformanceDate>2026-01-12</dcc:beginPerformanceDate>
  <dcc:endPerformanceDate>2026-01-15</dcc:endPerformanceDate>
  <dcc:performanceLocation>laboratory</dcc:performanceLocation>
  {issued}
</dcc:coreData>
<dcc:items><dcc:item>
  <dcc:name>{item}</dcc:name>
  <dcc:manufacturer><dcc:name><dcc:content>Example Spheres</dcc:content></dcc:name></dcc:manufacturer>
  <dcc:model>S 25</dcc:model>
  <dcc:identifications>
    <dcc:identification><dcc:issuer>customer</dcc:issuer><dcc:value>M-7</dcc:value></dcc:identification>
    <dcc:identification><dcc:issuer>manufacturer</dcc:issuer><dcc:value>4711</dcc:value></dcc:identification>
  </dcc:identifications>
</dcc:item></dcc:items>
<dcc:calibrationLaboratory>
  {code}
  <dcc:contact><dcc:name><dcc:content>Example Institute</dcc:content></dcc:name><dcc:eMail>a@b.example</dcc:eMail>
  <dcc:location><dcc:city>Exampletown</dcc:city><dcc:countryCode>DE</dcc:countryCode></dcc:location></dcc:contact>
</dcc:calibrationLaboratory>
<dcc:respPersons><dcc:respPerson>
  <dcc:person><dcc:name><dcc:content>First Example</dcc:content></dcc:name></dcc:person>
  <dcc:mainSigner>true</dcc:mainSigner>
</dcc:respPerson></dcc:respPersons>
<dcc:customer><dcc:name><dcc:content>Example Customer</dcc:content></dcc:name><dcc:eMail>c@d.example</dcc:eMail>
  <dcc:location><dcc:city>Exampleville</dcc:city><dcc:countryCode>FR</dcc:countryCode></dcc:location></dcc:customer>
{statements}
</dcc:administrativeData>
<dcc:measurementResults><dcc:measurementResult>
<dcc:name><dcc:content lang="en">Calibration</dcc:content></dcc:name>
{conditions}
<dcc:results>{results}</dcc:results>
</dcc:measurementResult></dcc:measurementResults>
</dcc:digitalCalibrationCertificate>
"""
RECALIBRATION = """<dcc:statements><dcc:statement refType="basic_recalibration">
  <dcc:declaration><dcc:content lang="en">To be calibrated again by</dcc:content></dcc:declaration>
  <dcc:date>2028-01-15</dcc:date>
</dcc:statement></dcc:statements>"""


def text(**languages):
    """Contents in some languages; `any` stands for none."""
    return "".join(
        f"<dcc:content>{words}</dcc:content>" if key == "any" else f'<dcc:content lang="{key}">{words}</dcc:content>'
        for key, words in languages.items()
    )


def dcc(version, results, *, item=None, statements="", conditions="", issued=True, code="EX-K-00001"):
    return HEAD.format(
        version=version,
        results=results,
        item=item or text(de="Kugelnormal", en="Reference sphere"),
        statements=statements,
        conditions=f"<dcc:influenceConditions>{conditions}</dcc:influenceConditions>" if conditions else "",
        issued="<dcc:issueDate>2026-01-20</dcc:issueDate>" if issued else "",
        code=f"<dcc:calibrationLaboratoryCode>{code}</dcc:calibrationLaboratoryCode>" if code else "",
    )


def result(name, *data, kind="dcc:data"):
    inside = "".join(data) if kind == "dcc:data" else f"<{kind}>{''.join(data)}</{kind}>"
    return f"<dcc:result><dcc:name>{name}</dcc:name><dcc:data>{inside}</dcc:data></dcc:result>"


def quantity(name, dsi, ref=None):
    attribute = f' refType="{ref}"' if ref else ""
    return f"<dcc:quantity{attribute}>{f'<dcc:name>{name}</dcc:name>' if name else ''}{dsi}</dcc:quantity>"


def condition(name, value, unit, ref=None):
    attribute = f' refType="{ref}"' if ref else ""
    inside = quantity(text(en="value"), real(value, unit))
    return (
        f"<dcc:influenceCondition{attribute}><dcc:name>{name}</dcc:name><dcc:data>{inside}</dcc:data>"
        "</dcc:influenceCondition>"
    )


def real(value, unit, uncertainty=""):
    return f"<si:real><si:value>{value}</si:value><si:unit>{unit}</si:unit>{uncertainty}</si:real>"


def expanded_unc(u, k="2", p="0.95"):
    """As in D-SI 1.x to 2.1."""
    return (
        f"<si:expandedUnc><si:uncertainty>{u}</si:uncertainty><si:coverageFactor>{k}</si:coverageFactor>"
        f"<si:coverageProbability>{p}</si:coverageProbability><si:distribution>normal</si:distribution></si:expandedUnc>"
    )


def expanded_mu(u, k="2", p="0.95"):
    """As in D-SI 2.2."""
    return (
        f"<si:measurementUncertaintyUnivariate><si:expandedMU><si:valueExpandedMU>{u}</si:valueExpandedMU>"
        f"<si:coverageFactor>{k}</si:coverageFactor><si:coverageProbability>{p}</si:coverageProbability>"
        "</si:expandedMU></si:measurementUncertaintyUnivariate>"
    )


def listed(values, unit, u="", k="2"):
    uncertainty = (
        f"<si:expandedUncXMLList><si:uncertaintyXMLList>{u}</si:uncertaintyXMLList>"
        f"<si:coverageFactorXMLList>{k}</si:coverageFactorXMLList>"
        "<si:coverageProbabilityXMLList>0.95</si:coverageProbabilityXMLList></si:expandedUncXMLList>"
    )
    return (
        f"<si:realListXMLList><si:valueXMLList>{values}</si:valueXMLList><si:unitXMLList>{unit}</si:unitXMLList>"
        f"{uncertainty if u else ''}</si:realListXMLList>"
    )


# A sphere, DCC 3.1.1, as a German institute may write it: diameter in m, form in um, one table.
SPHERE = dcc(
    "3.1.1",
    result(
        text(de="Messergebnisse", en="Measurement results"),
        quantity(text(de="Durchmesser", en="Diameter"), real("0.0250004", r"\metre", expanded_unc("2.0e-7"))),
        quantity(text(de="Formabweichung", en="Form deviation"), real("0.30", r"\micro\metre", expanded_unc("0.10"))),
        kind="dcc:list",
    ),
    statements=RECALIBRATION,
    conditions=condition(text(de="Bezugstemperatur", en="Reference temperature"), "293.15", r"\kelvin"),
    issued=False,
)
# A ball bar, DCC 3.2.1: nominal values and deviations as lists, U for all; the balls' form beside it.
BALL_BAR = dcc(
    "3.2.1",
    result(
        text(en="Distances between the centres of the balls"),
        quantity(text(en="Nominal"), listed("150 450 900", r"\milli\metre"), "basic_nominalValue"),
        quantity(
            text(en="Deviation from nominal"),
            listed("1.0 -2.5 3.0", r"\micro\metre", "0.8 1.0 1.2"),
            "basic_measurementError",
        ),
        kind="dcc:list",
    )
    + result(text(en="Balls"), quantity(text(en="Roundness"), listed("0.21 0.35", r"\micro\metre", "0.1"))),
    item=text(en="Ball bar"),
    conditions=condition(text(en="Ambient temperature"), "19.9", r"\degreecelsius", "basic_temperature")
    + condition(text(en="Coefficient of thermal expansion"), "1.1", r"\micro\metre\metre\tothe{-1}\kelvin\tothe{-1}"),
)
# A gauge block, DCC 3.3.0: a hybrid of m and mm, the uncertainty of D-SI 2.2, no accreditation.
GAUGE_BLOCK = dcc(
    "3.3.0",
    result(
        text(any="Zentrale Länge"),
        quantity(
            text(any="Zentrale Länge"),
            f"<si:hybrid>{real('100.00012', chr(92) + 'milli' + chr(92) + 'metre', expanded_mu('0.00006', '2.00'))}"
            f"{real('0.10000012', chr(92) + 'metre')}</si:hybrid>",
            "basic_measuredValue",
        ),
    ),
    item=text(de="Parallelendmaß", fr="Cale étalon"),
    code=None,
)
