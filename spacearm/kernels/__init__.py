"""Compiled kernels: one pass over the bodies of an arm for many configurations at once.

Only this folder imports numba, and it works on arrays only. The last index of every work array
counts *lanes*, configurations that are computed side by side, so that each line of a kernel becomes
a vector instruction of the processor. On a graphics card every thread has one configuration, and
there is one lane.

`lanes` has the compiler settings and small vector functions, `kept` what is kept on disk,
`floating` the equations of the floating arm, `singular_values` the singular values of its Jacobian,
`measures` the quantities computed from them, `cpu` the loops over blocks of lanes, `cuda` the same
for a graphics card.
"""
