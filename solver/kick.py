"""Sustained contacts: the impulses, at the middle pose of a step, that hold points on the surface.

- close: a row for each contact that is not open
- guess: the last step's forces
- aim: the velocities to reach, so that the end of the step meets the constraint
- hold: leave them if they hold; make all stick if they can; else sweep

Vectors are in body axes, where every contact's arm and matrices are constant.
"""

from math import sqrt

from .algebra import add, axpy, cross, dot, jit, put2, put6, scale, six2, to_body, to_world, vec2
from .contact import centripetal, gyroscopic
from .field import tangents, times_symmetric
from .model import CLOSED, OPEN, arm, gap_of, meet
from .stick import stick
from .sweep import (
    AIM,
    AXES,
    BEND,
    NORMAL,
    POINT,
    STRIKE_SWEEPS,
    TARGET,
    P,
    Q,
    agree,
    agree_later,
    fill,
    in_axes,
    in_body,
    in_cone,
    place,
    spread,
)

STILL = 3e-15
"""m/s: contacts this near their aims are left as they are."""

REST = 6e-15
"""m/s and rad/s: velocities that the contacts' forces change by less in a step do not change, and
are 0 where they are less themselves: so nothing creeps, and a body can fall asleep."""

ON_CONE = 0.999
"""A force that fills so much of its cone slides; then sweeping is quicker than trying to stick, unless
what slides is all but still."""

PUSHED = 1e-4
"""Of m (g h)²: friction that holds where it slipped may do so much work, from rounding in the slip."""

SWEEPS = 12
AGREED = 5e-4
"""Of g h: how well the sweeps agree. What is left is taken up by the next step, which starts from
this one's forces."""

FINEST = 1e-12
"""m/s; where there is no gravity."""

COLD = 1e-3
"""m/s, beyond g h: sweeps that still change so much had a first guess that was worse than none."""

NOTHING = (0.0, 0.0, 0.0)


@jit
def begin(rows, c, hull, k, field, view):
    """Begin row c for hull point k."""
    R, _x, frame, _height = view
    _phi, N_b, H = meet(hull, k, field, view)
    _b, q = arm(hull, k, N_b)
    if field is None:
        place(rows, c, k, frame, q)
    else:
        N = to_world(R, N_b)
        t1, t2 = tangents(N)
        place(rows, c, k, (N_b, to_body(R, t1), to_body(R, t2)), q)
        put2(rows, c, NORMAL, N)
        put6(rows, c, BEND, H)


@jit
def close(hull, field, view, contacts, rows):
    """Begin a row for each contact that is not OPEN. Returns how many."""
    n = 0
    for k in range(hull.shape[0]):
        if contacts[k, 0] != OPEN:
            begin(rows, n, hull, k, field, view)
            n += 1
    return n


@jit
def guess(mu, contacts, rows, n, h):
    """The last step's forces: the rows get their impulses.

    Returns:
        (F, T, push, slide): their sum and moment; do all contacts push, does any slide?
    """
    F = (0.0, 0.0, 0.0)
    T = (0.0, 0.0, 0.0)
    push, slide = True, mu is None or mu == 0.0
    for c in range(n):
        p = scale(h, vec2(contacts, int(rows[c, POINT]), 1))
        put2(rows, c, P, p)
        push = push and p[0] > 0.0
        if mu is not None:
            slide = slide or (p[0] > 0.0 and not in_cone(p, ON_CONE * mu))
        p = in_body(rows, c, p)
        F = add(F, p)
        T = add(T, cross(vec2(rows, c, Q), p))
    return F, T, push, slide


@jit
def turning(rows, c, field, R, b, rho, v, w, u_dot):
    """How a contact point's velocity u changes, given how it would if N did not turn, m/s².

    Over curved ground Ṅ = H ċ, with ċ the hull point's velocity, and q = b − ρN turns with it: that adds
    −ρ w × Ṅ. The rate of N·u has Ṅ·u beside N·u̇; in all, along N, it is Eq. 5's ċᵀHċ that is added.
    """
    if field is None:
        return u_dot
    N_dot = to_body(R, times_symmetric(six2(rows, c, BEND), to_world(R, add(v, cross(w, b)))))
    u = add(v, cross(w, vec2(rows, c, Q)))
    u_dot = axpy(dot(N_dot, u), vec2(rows, c, AXES), u_dot)
    return axpy(-rho, cross(w, N_dot), u_dot)


@jit
def carried(centri, w, w_dot, b, q):
    """How a contact point accelerates as the body turns, m/s²; Eq. 5's w × (w × b) may be left out."""
    if centri is None:
        return cross(w_dot, q)
    return centripetal(w, w_dot, b, q)


@jit
def aim(J, inv_J, gyro, centri, hull, field, view, v, w, contacts, rows, n, h):
    """What to aim at: Eq. 5's c at velocity level, u = −(h/2) c, with the spin that is expected.

    Without it, sustained contact is of first order. A LATE point, still above the surface, may come
    down to it by the end of the step.

    Returns:
        How far from it any contact's velocity is, m/s.
    """
    w_dot = (0.0, 0.0, 0.0) if gyro is None else gyroscopic(J, inv_J, w)
    half = 0.5 * h
    worst = 0.0
    for c in range(n):
        k = int(rows[c, POINT])
        q = vec2(rows, c, Q)
        if contacts[k, 0] == CLOSED:
            b = vec2(hull, k, 0)
            u_dot = carried(centri, w, w_dot, b, q)
            u = scale(-half, turning(rows, c, field, view[0], b, hull[k, 3], v, w, u_dot))
        else:
            N = vec2(rows, c, AXES)
            u = scale(-max(0.0, gap_of(hull, k, field, view)) / half, N)
        put2(rows, c, AIM, u)
        r = axpy(-1.0, u, add(v, cross(w, q)))
        worst = max(worst, abs(r[0]), abs(r[1]), abs(r[2]))
    return worst


@jit
def change(a, b):
    """The largest difference between two vectors' components."""
    return max(abs(a[0] - b[0]), abs(a[1] - b[1]), abs(a[2] - b[2]))


@jit
def work(rows, n, v, w):
    """Twice the work of friction over a step that begins at (v, w) and holds every contact, J."""
    total = 0.0
    for c in range(n):
        u = add(v, cross(w, vec2(rows, c, Q)))
        u = in_axes(rows, c, add(u, vec2(rows, c, AIM)))
        total += rows[c, P + 1] * u[1] + rows[c, P + 2] * u[2]
    return total


@jit
def hold(
    body, hull, field, view, mu, gyro, several, centri, a, v_before, w_before, v, w, contacts, rows, n, h
):
    """The velocities after the impulses of n contacts.

    Args:
        body: as in `step`.
        hull: as in `step`.
        field: as in `step`'s ground.
        view: of the ground from the middle pose.
        mu: as in `step`'s law, and so are
        gyro: this,
        several: this
        centri: and this.
        a: g + F_ext/m.
        v_before: velocity before gravity, world axes; friction opposes the mean of the slip before
            and after.
        w_before: angular velocity before the torque.
        v: velocity with gravity in it, world axes.
        w: angular velocity with the torque in it.
        contacts: memory.
        rows: n begun rows.
        n: how many.
        h: s.

    Returns:
        (v, w).
    """
    m, inv_m, J, inv_J, _bound = body
    R = view[0]
    v_b = to_body(R, v)
    F, T, push, slide = guess(mu, contacts, rows, n, h)
    v1, w1 = spread(inv_m, inv_J, F, T, v_b, w)
    far = aim(J, inv_J, gyro, centri, hull, field, view, v1, w1, contacts, rows, n, h)
    if push and not slide and far < STILL:
        # At rest nothing changes at all: residuals that add up would have to be undone in the end.
        v1 = to_world(R, v1)
        rests = change(v1, v_before) < REST and change(w1, w_before) < REST
        if rests and dot(v_before, v_before) + dot(w_before, w_before) < REST * REST:
            return NOTHING, NOTHING
        return (v_before, w_before) if rests else (v1, w1)
    gh = h * sqrt(dot(a, a))
    before = to_body(R, v_before)
    if mu is not None and several is not None:
        if n > 1 and (not slide or (mu > 0.0 and far < gh)):
            done, v2, w2 = stick(rows, n, m, inv_m, J, inv_J, mu, v1, w1, F, T)
            if done and work(rows, n, before, w_before) <= PUSHED * m * gh * gh:
                return to_world(R, v2), w2
            guess(mu, contacts, rows, n, h)
    for c in range(n):
        fill(rows, c, inv_m, inv_J, mu, before, w_before)
        put2(rows, c, TARGET, in_axes(rows, c, vec2(rows, c, AIM)))
    enough = max(FINEST, AGREED * gh)
    v1, w1, left = agree(rows, n, inv_m, mu, several, 1.0, 1.0, v1, w1, SWEEPS, enough)
    if several is not None and left > COLD + gh:
        for c in range(n):
            put2(rows, c, P, (0.0, 0.0, 0.0))
        v1, w1, left = agree_later(rows, n, inv_m, mu, several, 1.0, 1.0, v_b, w, STRIKE_SWEEPS, enough)
    return to_world(R, v1), w1
