"""Sustained contacts: the impulses, at the middle pose of a step, that hold points on the surface.

- close: a row for each contact that is not open
- guess: the last step's forces
- aim: the velocities to reach, so that the end of the step meets the constraint
- hold: leave them if they hold; make all stick if they can; else sweep

Vectors are in body axes, where every contact's arm and matrices are constant.
"""

import numpy as np

from .algebra import (
    add,
    axpy,
    cross,
    dot,
    jit,
    put2,
    put6,
    scale,
    six2,
    to_body,
    to_world,
    vec2,
)
from .contact import centripetal, gyroscopic
from .field import tangents, times_symmetric
from .model import CLOSED, OPEN, meet
from .stick import stick
from .sweep import (
    AIM,
    AXES,
    BEND,
    FORCE,
    GAP,
    HELD,
    NORMAL,
    RHO,
    STRIKE_SWEEPS,
    TARGET,
    B,
    P,
    Q,
    agree,
    fill,
    in_axes,
    in_body,
    in_cone,
    place,
    spread,
    stand,
)
from .trace import every, filled, largest, most, no, some, sqrt, traced, where

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

SWEEPS = np.intp(12)
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
    phi, N_b, H = meet(hull, k, field, view)
    stand(rows, c, hull, k)
    rows[c, GAP] = phi
    q = axpy(-hull[k, 3], N_b, vec2(hull, k, 0))
    if field is None:
        place(rows, c, frame, q)
    else:
        N = to_world(R, N_b)
        t1, t2 = tangents(N)
        place(rows, c, (N_b, to_body(R, t1), to_body(R, t2)), q)
        put2(rows, c, NORMAL, N)
        put6(rows, c, BEND, H)


@jit
def close(hull, field, view, contacts, rows):
    """Begin a row for each contact that is not OPEN. Returns how many."""
    n = 0
    for k in range(hull.shape[0]):
        if contacts[k, 0] != OPEN:
            begin(rows, n, hull, k, field, view)
            put2(rows, n, FORCE, vec2(contacts, k, 1))
            rows[n, HELD] = 1.0 if contacts[k, 0] == CLOSED else 0.0
            n += 1
    return n


@traced
def again(rows, c, view):
    """Begin row c once more, from another pose, over a plane."""
    frame = view[2]
    place(rows, c, frame, axpy(-rows[c, RHO], frame[0], vec2(rows, c, B)))


@traced
def _guessed(rows, c, mu, on, h, F, T, push, slide):
    """What row c adds to `guess`."""
    p = where(on, scale(h, vec2(rows, c, FORCE)), NOTHING)
    put2(rows, c, P, p)
    push = push & (no(on) | (p[0] > 0.0))
    if mu is not None:
        slide = slide | (on & (p[0] > 0.0) & no(in_cone(p, ON_CONE * mu)))
    p = in_body(rows, c, p)
    F1, T1 = add(F, p), add(T, cross(vec2(rows, c, Q), p))
    return where(on, F1, F), where(on, T1, T), push, slide


@jit
def guess(mu, rows, n, h, zero):
    """The last step's forces: the rows get their impulses.

    Returns:
        (F, T, push, slide): their sum and moment; do all contacts push, does any slide?
    """
    F, T = (zero, zero, zero), (zero, zero, zero)
    push = filled(zero, True)
    slide = slides_anyway(mu, zero)
    for c in range(int(largest(n))):
        F, T, push, slide = _guessed(rows, c, mu, c < n, h, F, T, push, slide)
    return F, T, push, slide


@traced
def slides_anyway(mu, zero):
    """Without friction every contact does."""
    return filled(zero, True) if mu is None else filled(zero, False) | (mu == 0.0)


@traced
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


@traced
def carried(centri, w, w_dot, b, q):
    """How a contact point accelerates as the body turns, m/s²; Eq. 5's w × (w × b) may be left out."""
    if centri is None:
        return cross(w_dot, q)
    return centripetal(w, w_dot, b, q)


@traced
def _aimed(rows, c, w_dot, centri, field, view, on, v, w, half, worst):
    """What row c adds to `aim`."""
    b, q = vec2(rows, c, B), vec2(rows, c, Q)
    u_dot = carried(centri, w, w_dot, b, q)
    held = scale(-half, turning(rows, c, field, view[0], b, rows[c, RHO], v, w, u_dot))
    kept = scale(-most(0.0, rows[c, GAP]) / half, vec2(rows, c, AXES))
    u = where(rows[c, HELD] > 0.0, held, kept)
    put2(rows, c, AIM, u)
    r = axpy(-1.0, u, add(v, cross(w, q)))
    far = most(most(most(worst, abs(r[0])), abs(r[1])), abs(r[2]))
    return where(on, far, worst)


@jit
def aim(J, inv_J, gyro, centri, field, view, v, w, rows, n, h):
    """What to aim at: Eq. 5's c at velocity level, u = −(h/2) c, with the spin that is expected.

    Without it, sustained contact is of first order. A point that is only kept from passing through, still
    above the surface, may come down to it by the end of the step.

    Returns:
        How far from it any contact's velocity is, m/s.
    """
    w_dot = spin_rate(J, inv_J, gyro, w)
    worst = filled(v[0], 0.0)
    for c in range(int(largest(n))):
        worst = _aimed(rows, c, w_dot, centri, field, view, c < n, v, w, 0.5 * h, worst)
    return worst


@traced
def spin_rate(J, inv_J, gyro, w):
    """ẇ = −J⁻¹ (w × J w), unless it is left out."""
    return NOTHING if gyro is None else gyroscopic(J, inv_J, w)


@traced
def change(a, b):
    """The largest difference between two vectors' components."""
    return most(most(abs(a[0] - b[0]), abs(a[1] - b[1])), abs(a[2] - b[2]))


@traced
def _worked(rows, c, on, v, w, total):
    """What row c adds to `work`."""
    u = add(v, cross(w, vec2(rows, c, Q)))
    u = in_axes(rows, c, add(u, vec2(rows, c, AIM)))
    return where(on, total + (rows[c, P + 1] * u[1] + rows[c, P + 2] * u[2]), total)


@jit
def work(rows, n, v, w):
    """Twice the work of friction over a step that begins at (v, w) and holds every contact, J."""
    total = filled(v[0], 0.0)
    for c in range(int(largest(n))):
        total = _worked(rows, c, c < n, v, w, total)
    return total


@traced
def resting(R, n, v1, w1, v, w, v_before, w_before, rests):
    """Where nothing is to be done: (that it is so, v, w).

    (v1, w1) are the velocities with the last step's forces, `rests` that these hold every contact.
    """
    # At rest nothing changes at all: residuals that add up would have to be undone in the end.
    v1 = to_world(R, v1)
    same = (change(v1, v_before) < REST) & (change(w1, w_before) < REST)
    slow = dot(v_before, v_before) + dot(w_before, w_before) < REST * REST
    held = where(same, where(slow, (NOTHING, NOTHING), (v_before, w_before)), (v1, w1))
    v1, w1 = where(n == 0, (v, w), held)
    return (n == 0) | rests, v1, w1


@jit
def hold(body, field, view, mu, gyro, several, centri, a, v_before, w_before, v, w, rows, n, h):
    """The velocities after the impulses of n contacts.

    Args:
        body: as in `step`.
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
        rows: n begun rows.
        n: how many.
        h: s.

    Returns:
        (v, w).
    """
    m, inv_m, J, inv_J, _bound = body
    R = view[0]
    v_b = to_body(R, v)
    F, T, push, slide = guess(mu, rows, n, h, filled(v[0], 0.0))
    v1, w1 = spread(inv_m, inv_J, F, T, v_b, w)
    far = aim(J, inv_J, gyro, centri, field, view, v1, w1, rows, n, h)
    done, v_done, w_done = resting(R, n, v1, w1, v, w, v_before, w_before, push & no(slide) & (far < STILL))
    if every(done):
        return v_done, w_done
    gh = h * sqrt(dot(a, a))
    before = to_body(R, v_before)
    if mu is not None and several is not None:
        tries = (n > 1) & no(done) & (no(slide) | ((mu > 0.0) & (far < gh)))
        if some(tries):
            sticks, v2, w2 = stick(rows, n, m, inv_m, J, inv_J, mu, tries, v1, w1, F, T)
            sticks = sticks & (work(rows, n, before, w_before) <= PUSHED * m * gh * gh)
            v_done, w_done = where(sticks, (to_world(R, v2), w2), (v_done, w_done))
            done = done | sticks
            if every(done):
                return v_done, w_done
            for c in range(int(largest(n))):
                guess_again(rows, c, tries & no(sticks), h)
    for c in range(int(largest(n))):
        fill(rows, c, inv_m, inv_J, mu, before, w_before)
        put2(rows, c, TARGET, in_axes(rows, c, vec2(rows, c, AIM)))
    enough = most(FINEST, AGREED * gh)
    v1, w1, left = agree(rows, n, inv_m, mu, several, 1.0, 1.0, no(done), v1, w1, SWEEPS, enough)
    if several is not None:
        cold = no(done) & (left > COLD + gh)
        if some(cold):
            for c in range(int(largest(n))):
                put2(rows, c, P, where(cold, NOTHING, vec2(rows, c, P)))
            v2, w2, _left = agree(rows, n, inv_m, mu, several, 1.0, 1.0, cold, v_b, w, STRIKE_SWEEPS, enough)
            v1, w1 = where(cold, (v2, w2), (v1, w1))
    return where(done, (v_done, w_done), (to_world(R, v1), w1))


@traced
def guess_again(rows, c, on, h):
    """Row c's impulse as `guess` has it, where it is on."""
    put2(rows, c, P, where(on, scale(h, vec2(rows, c, FORCE)), vec2(rows, c, P)))
