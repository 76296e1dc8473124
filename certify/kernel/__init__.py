"""The trusted kernel: reads a spec and a certificate, and decides whether the certificate proves what it says.

Standard library only, exact rationals only, no imports from the rest of the package. Run it by itself with
`python -m certify.kernel SPEC CERT`.
"""
