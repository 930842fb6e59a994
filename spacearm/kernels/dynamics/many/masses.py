"""The masses of many states: the steps of `dynamics.masses`, each over the lanes innermost."""

from __future__ import annotations

from spacearm.kernels.dynamics.many.work import Swinging, rows, six, store, store_six
from spacearm.kernels.dynamics.masses import factors, plus, shifted, steiner
from spacearm.kernels.floating import Bodies
from spacearm.kernels.lanes import (
    LANES,
    add,
    cross,
    dot,
    merged,
    minus,
    read,
    read_rows,
    symmetric,
    times,
    turn,
    vector,
)


@merged
def place(b: Bodies, m: Swinging, i: int) -> None:
    """Compute attitude, joint, CM and inertia of body i, and its share of the system CM."""
    own, k, inner = b[i], m.body[i], m.body[b[i].parent]
    E, t, c, I = read_rows(own.E), read(own.t), read(own.c), read_rows(own.I)
    mu = own.m / b[0].carried
    for l in range(LANES):
        X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
        a, e = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if i > 0:
            R, sin, cos, slide = rows(inner.R, l), m.angle[1, i - 1, l], m.angle[2, i - 1, l], 0.0
            if own.slides:
                sin, cos, slide = 0.0, 1.0, m.angle[0, i - 1, l]
            E_x = turn(R, (E[0][0], E[1][0], E[2][0]))
            E_y = turn(R, (E[0][1], E[1][1], E[2][1]))
            E_z = turn(R, (E[0][2], E[1][2], E[2][2]))
            x = add(times(cos, E_x), times(sin, E_y))
            y = minus(times(cos, E_y), times(sin, E_x))
            X, Y, Z = (x[0], y[0], E_z[0]), (x[1], y[1], E_z[1]), (x[2], y[2], E_z[2])
            e = add(turn(R, t), times(slide, E_z))
            a = add(vector(inner.a, l), e)
        r = turn((X, Y, Z), c)
        store(k.R[0], l, X)
        store(k.R[1], l, Y)
        store(k.R[2], l, Z)
        store(k.a, l, a)
        store(k.e, l, e)
        store(k.r, l, r)
        store(m.center, l, add(vector(m.center, l), times(mu, add(a, r))))
        IX, IY, IZ = turn(I, X), turn(I, Y), turn(I, Z)
        J = (dot(IX, X), dot(IX, Y), dot(IX, Z), dot(IY, Y), dot(IY, Z), dot(IZ, Z))
        store_six(k.J, l, J)
        store_six(k.I, l, plus(J, steiner(own.m, r)))
        store(k.s, l, times(own.m, r))


@merged
def inertia(b: Bodies, m: Swinging) -> None:
    """Compute D and its factors."""
    for l in range(LANES):
        store_six(m.D, l, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    for i in range(len(b)):
        k, mass = m.body[i], b[i].m
        for l in range(LANES):
            r = minus(add(vector(k.a, l), vector(k.r, l)), vector(m.center, l))
            store_six(m.D, l, plus(six(m.D, l), plus(six(k.J, l), steiner(mass, r))))
    for l in range(LANES):
        store_six(m.D, l, factors(six(m.D, l)))


@merged
def carry(b: Bodies, m: Swinging, i: int) -> None:
    """Add what joint i carries to what its parent's joint carries."""
    inner, outer, mass = m.body[b[i].parent], m.body[i], b[i].carried
    for l in range(LANES):
        e, s = vector(outer.e, l), vector(outer.s, l)
        moved = shifted(mass, s, e)
        store_six(inner.I, l, plus(six(inner.I, l), plus(six(outer.I, l), moved)))
        store(inner.s, l, add(vector(inner.s, l), add(s, times(mass, e))))


@merged
def column(b: Bodies, m: Swinging, i: int) -> None:
    """Add joint i to its column of P, D_q and M_qq; its momentum waits in f and n."""
    own, d = b[i], m.body[i]
    mass, j = own.carried, own.column
    for l in range(LANES):
        u = times(own.gain, (d.R[0, 2, l], d.R[1, 2, l], d.R[2, 2, l]))
        s, a = vector(d.s, l), minus(vector(d.a, l), vector(m.center, l))
        if own.slides:
            p, h, v, turns = times(mass, u), cross(s, u), u, 0.0
            along = dot(u, p)
        else:
            p, h, v, turns = cross(u, s), symmetric(six(d.I, l), u), cross(a, u), 1.0
            along = dot(u, h)
        m.H[j, j, l] += along
        store(d.u, l, times(turns, u))
        store(d.v, l, v)
        store(m.P[j], l, add(vector(m.P[j], l), p))
        store(m.D_q[j], l, add(vector(m.D_q[j], l), add(h, cross(a, p))))
        store(d.f, l, p)
        store(d.n, l, h)
    o, before = own.parent, i
    while o > 0:
        inner, c, e = m.body[o], b[o].column, m.body[before].e
        entry, weight = m.H[max(j, c), min(j, c)], 2.0 if j == c else 1.0
        for l in range(LANES):
            p = vector(d.f, l)
            h = add(vector(d.n, l), cross(vector(e, l), p))  # the moment, from joint to joint
            store(d.n, l, h)
            along = dot(vector(inner.v, l), p) if b[o].slides else dot(vector(inner.u, l), h)
            entry[l] += weight * along
        o, before = b[o].parent, o
