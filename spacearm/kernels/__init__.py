"""Compiled kernels: one pass over the bodies of an arm for many configurations at once.

Arrays only, and the one place that imports numba. Memory is laid out in *lanes*: the last index of
every work array counts configurations that are computed side by side, so that each line of a
kernel becomes a vector instruction on a processor; on a graphics card, where every thread has one
configuration, there is one lane.

`lanes` holds what a lane is made of, `floating` the equations of the floating arm,
`singular_values` what a Jacobian is brought to, `measures` what is asked of it, `cpu` the loop over
blocks of lanes, `cuda` the same for threads of a graphics card.
"""
