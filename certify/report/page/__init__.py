"""The report of a certificate: one self-contained HTML page, and a Markdown summary.

Everything that is called proved here comes from a verdict of the kernel on the certificate and the spec; what is
computed in floats beside it (curves, motion) says so.
"""
