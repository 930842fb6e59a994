"""The equations of an arm as functions for JAX, CasADi and C, and tasks and barriers for pink."""
