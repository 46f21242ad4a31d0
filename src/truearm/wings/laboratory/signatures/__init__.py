"""Signatures: X.509 certificates, signed XML, and XML files in a PDF."""
