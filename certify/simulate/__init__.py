"""The simulator's side of a spec. It shares no model code with the kernel."""
