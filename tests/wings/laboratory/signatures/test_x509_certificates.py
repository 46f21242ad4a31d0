"""Chains of certificates: who is known by whom."""

import pytest
from cryptography.hazmat.primitives.asymmetric import rsa

from made_up_signers import authority, certified, curve_key, usage, x509
from truearm.wings.laboratory.signatures.x509_certificates import MAX_CERTIFICATES, chain_to_trusted

ROOT = authority("Root CA")


def below(*, by, **others):
    return certified(curve_key(), by=by, **others)


def test_a_chain_goes_from_the_signer_to_a_trusted_certificate():
    middle = authority("Middle CA", by=ROOT)
    lowest = authority("Lowest CA", by=middle)
    signer, others = below(by=lowest), [ROOT[1], lowest[1], middle[1]]
    assert chain_to_trusted(signer, [ROOT[1]], others) == (signer, lowest[1], middle[1], ROOT[1])
    assert chain_to_trusted(signer, [middle[1]], others) == (signer, lowest[1], middle[1])
    assert chain_to_trusted(signer, [signer], []) == (signer,)
    assert chain_to_trusted(signer, [ROOT[1]], [middle[1]]) == ()  # the lowest is missing
    assert chain_to_trusted(signer, [], others) == ()


@pytest.mark.parametrize(
    "others",
    [
        {"extensions": ()},
        {"extensions": (x509.BasicConstraints(False, None),)},
        {"extensions": (x509.BasicConstraints(True, None), usage(digital_signature=True))},
        {"extensions": (x509.BasicConstraints(True, None), x509.NameConstraints([x509.DNSName("example.org")], None))},
        {
            "extensions": (
                x509.BasicConstraints(True, None),
                x509.UnrecognizedExtension(x509.ObjectIdentifier("1.2.3"), b""),
            )
        },
    ],
)
def test_only_an_authority_issues_certificates(others):
    """Neither another laboratory's certificate nor one with conditions that are not checked here makes a chain."""
    wrong = authority("Wrong CA", **others)
    assert chain_to_trusted(below(by=wrong), [wrong[1]], []) == ()
    between = authority("Between", by=ROOT, **others)
    assert chain_to_trusted(below(by=between), [ROOT[1]], [between[1]]) == ()


def test_an_authority_with_the_same_name_is_another_one():
    namesake = authority("Root CA")
    assert chain_to_trusted(below(by=namesake), [ROOT[1]], [namesake[1]]) == ()
    assert chain_to_trusted(below(by=ROOT), [namesake[1], ROOT[1]], [])[-1] == ROOT[1]


def test_the_length_of_a_chain_is_limited_by_its_authorities():
    short = authority("Short CA", length=0)
    signer = below(by=short)
    assert chain_to_trusted(signer, [short[1]], []) == (signer, short[1])
    middle = authority("Middle CA", by=short)
    assert chain_to_trusted(below(by=middle), [short[1]], [middle[1]]) == ()


def test_a_weak_authority_makes_no_chain():
    key = rsa.generate_private_key(65537, 1024)
    weak = key, certified(key, "Weak CA", extensions=(x509.BasicConstraints(True, None),))
    assert chain_to_trusted(below(by=weak), [weak[1]], []) == ()


def test_authorities_that_issued_each_other_end():
    """A file may contain a circle of authorities; each is looked at once."""
    keys = [curve_key() for _ in range(3)]
    constraints = (x509.BasicConstraints(True, None),)
    own = [certified(key, f"CA {i}", extensions=constraints) for i, key in enumerate(keys)]
    circle = [
        certified(keys[i], f"CA {i}", by=(keys[j], own[j]), extensions=constraints)
        for i in range(3)
        for j in range(3)
        if i != j
    ]
    assert len(circle) < MAX_CERTIFICATES
    signer = below(by=(keys[0], own[0]))
    assert chain_to_trusted(signer, [ROOT[1]], circle) == ()
    assert chain_to_trusted(signer, [own[2]], circle) == (signer, circle[1], own[2])
