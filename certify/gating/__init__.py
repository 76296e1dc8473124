"""The gate: whether specs may pass, by committed certificates where those still hold. It renders nothing."""
