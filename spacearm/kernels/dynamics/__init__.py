"""Dynamics of floating arms in compiled code, and their integration in time.

`equations` has the equations of motion of any tree, in lanes: one state or many side by side,
`masses` the mass matrix in them. `context` is all that a run reads and writes, `memory` its arrays,
`calls` how compiled functions call each other and those outside. `rate` has the rate of the state,
`laws` the built-in control laws, `tips` what they and the events need of the tips, `decomposition`
the linear algebra. `runge_kutta` and `radau` integrate, `events` finds roots, `advance` steps a run
to its end, `observe` reports it.
"""
