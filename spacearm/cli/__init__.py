"""The command line: one module for each command; `options` and `output` are shared."""
