"""All twelve states are tied to the four controls: an enclosure of what is flown.

State x, y, z, vx, vy, vz (show frame, z up), roll phi, pitch theta, yaw psi, p, q, r;
control thrust U1 and torques U2, U3, U4. With f the torque factor of the vehicle:

    position' = velocity
    velocity' = U1 / m b - (0, 0, g),  b = (cos phi sin theta cos psi + sin phi sin psi,
                                            cos phi sin theta sin psi - sin phi cos psi,
                                            cos phi cos theta)
    angles'   = (p, q, r)
    p' = f U2 / Ix + c1 q r,  q' = f U3 / Iy + c2 p r,  r' = U4 / Iz + c3 p q
    c1 = (Iy - Iz) / Ix,      c2 = (Iz - Ix) / Iy,      c3 = (Ix - Iy) / Iz

The controls that count are those that four rotors can give: the logged ones, turned
into squared rotor speeds, clipped to [0, greatest squared speed] and turned back.

**Theorem.** Let a drone fly these controls from the first logged state of a window.
Then at every instant of the window each of its twelve states differs from the logged
polynomials by no more than :func:`radius` says, jumps of the polynomials included. The
first window of a segment begins with it, the next with the first mesh interval, or part
of a longer one, after each :data:`WINDOW`: what is flown without feedback for longer
leaves any path. So do windows with each interval in which it hovers, and with the one
after: there it waits. Of all windows in each :data:`WINDOW` radii add up; jumps between
windows add up over the whole segment.

Proof. Write ~ for what is logged, e for flown minus logged, T for the window's time.

1. *Defects.* For a right side f known in time, the flown y1 = y1(0) + integral of f and
   y2 = y2(0) + integral of y1 are worked out as polynomials on each mesh interval:
   f is interpolated in N + 1 Chebyshev points. Where f is a polynomial of degree <= N
   (angular accelerations) that is exact. Else f, an entire function, is bounded by M on
   the ellipse with foci at the interval's ends and axes of sum rho, and the interpolant
   is off by at most 4 M rho^-N / (rho - 1) (Trefethen 2013, Approximation Theory and
   Approximation Practice, theorem 8.2). M follows from the Chebyshev coefficients a_k
   of thrust and angles: on the ellipse |T_k| <= rho^k, |Im T_k| <= (rho^k - rho^-k) /
   2, and |sin z|, |cos z| <= cosh(Im z). The difference to the logged y1 and y2 is a
   polynomial too, and the sum of its absolute Chebyshev coefficients encloses it (|T_k|
   <= 1). Signs are kept until then: defects that cancel along the flight do cancel.
2. *Rates.* With Delta = ~w(0) + integral of f(~w) - ~w, the right side taken along
   the logged rates ~w, e = Delta + integral of (g(~w + e) - g(~w)), g the products.
   q r - ~q ~r = ~q e_r + ~r e_q + e_q e_r, so with the greatest norm
   |g(~w + e) - g(~w)| <= l |e|, l = max c_i (|~w_j| + |~w_k| + eta), as long as
   |e| <= eta. By Gronwall's inequality (Walter 1970, Differential and Integral
   Inequalities, section 1.III; Hairer, Norsett, Wanner 1993, Solving Ordinary
   Differential Equations I, theorem I.10.2) |e| <= a exp(L), a = sup |Delta|,
   L = integral of l. Where that is below eta, e, being continuous but for the jumps in
   Delta, cannot leave |e| <= eta. So |e_i| <= sup |Delta_i| + G, G = a (exp(L) - 1).
3. *Angles.* Their defect is worked out in step 1 with y1 the rates; G adds at most T G.
4. *Velocity and position.* Each component of b has slopes of at most 1 in each angle:
   the velocity gets at most A = T (U / m) (|e_phi| + |e_theta| + |e_psi|) besides its
   defect, the position T A / 2, U being the thrust of four rotors at full speed.

*Clipping.* Where coefficients of a squared rotor speed leave [0, 1] of the greatest, by
kappa at most, the right sides are off by what kappa of all rotors gives.

*Rounding.* A sum of n products in float64 is off by at most gamma_n = n u / (1 - n u)
times the sum of its absolute values, u = 2^-53 (Higham 2002, Accuracy and Stability of
Numerical Algorithms, section 3.1); sines and cosines are taken to be right to 4 u. No
result here takes more than 1000 such steps, halvings of intervals and the entries of
matrices included, and all factors of a linear map add up to the gain of a scheme.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial.chebyshev import chebint

from showc.verify.kernel.bernstein import basis, halves, rows_last
from showc.verify.kernel.show import PieceTable, Seen, Statement, worst, xyz

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.log.showc_pb2 import Vehicle
    from showc.verify.kernel.show import LoggedShow, Segment

GAMMA = 1000 * 2.0**-53 / (1.0 - 1000 * 2.0**-53)
"""gamma_1000: relative rounding of anything worked out here, before gains."""

ETA = 1e-3
"""Deviation of the rates [rad/s] up to which step 2 holds: far above any tolerance."""

WINDOW = 20.0
"""Longest time that is flown from one logged state [s]; most transitions are shorter.
Bounds grow with its square: a drone tilted by 1e-7 rad for ten minutes is 0.2 m off."""

STILL = 1e-9  # extent of a mesh interval's positions that is rounding: it hovers [m]

_FINE = 1e-8
"""Interpolation error [m/s²] above which an interval is halved: over 10 s it moves a
drone by less than 1 um."""

_CLIPPED = 1e-9
"""Share of the greatest squared rotor speed by which coefficients may leave what rotors
can do before an interval is halved: coefficients leave it where values do not."""

_HALVINGS, _MORE, _LONG = 6, 4_000, 5e6
"""How often an interval is halved at most, and by how many more there may be before it;
what is then left stays in the bound. Time of all drones, times coefficients, to which
intervals are halved to windows [s]: that of a thousand which hover for an hour."""

_ELLIPSES = (1.5, 2.0, 3.0, 5.0, 8.0, 13.0, 30.0, 1e3)
"""Values of rho that are tried; each gives a bound, the least one counts."""

POSITION, VELOCITY = 5e-4, 5e-4
"""Greatest distance of flown from logged positions [m] and velocities [m/s].

Two logs with the same controls and first states, both proved, differ by no more than
twice that: nothing can move by more than 1 mm or 1 mm/s and stay proved. A planner
that writes what its controls fly stays far below (1e-5 on the shows of showc)."""

ANGLE, RATE = float(np.radians(0.005)), float(np.radians(0.005))
"""The same of each angle [rad] and body rate [rad/s]: 0.01 deg and 0.01 deg/s."""

TOLERANCES = np.repeat([POSITION, VELOCITY, ANGLE, RATE], 3)
"""The same for each of the twelve states (SI)."""

_Pair = tuple["FloatArray", "FloatArray"]
_Scheme = tuple[int, _Pair, _Pair, float]

_AT_ONCE = 1_000  # mesh intervals taken together: they stay in the processor's cache

_SIGNS = np.array(
    [[1.0, 1.0, 1.0, 1.0], [0.0, -1.0, 0.0, 1.0], [1.0, 0.0, -1.0, 0.0], [1, -1, 1, -1]]
)
"""What each rotor (column) adds to thrust and torques (rows, square to each other)."""


def allocation(vehicle: Vehicle) -> FloatArray:
    """Matrix (4, 4) from squared rotor speeds, over the greatest, to the control."""
    top = vehicle.rotor_speed_max**2
    push, turn = vehicle.thrust_coefficient * top, vehicle.torque_coefficient * top
    arm = push * vehicle.arm_length
    return np.asarray(np.array([push, arm, arm, turn])[:, None] * _SIGNS)


def rotor_shares(vehicle: Vehicle) -> FloatArray:
    """Inverse of :func:`allocation`: each entry is right to 8 roundings."""
    matrix = allocation(vehicle)
    return np.asarray((matrix / (matrix**2).sum(axis=1, keepdims=True)).T)


def ties(show: LoggedShow, radii: Sequence[FloatArray]) -> list[Statement]:
    """State how near flown states stay to logged ones: :func:`radius` of all segments.

    Positions and velocities count as lengths, angles and rates each for itself.
    """
    kinds = (
        ("VRF301", POSITION, "m", 1.0, 2.0),
        ("VRF303", VELOCITY, "m/s", 1.0, 2.0),
        ("VRF302", ANGLE, "deg", float(np.degrees(1.0)), np.inf),
        ("VRF304", RATE, "deg/s", float(np.degrees(1.0)), np.inf),
    )
    fleet, found = np.arange(show.drones), []
    for kind, (code, limit, unit, turn, order) in enumerate(kinds):
        seen = [
            Seen(one.message.name, one.start, fleet, turn * size)
            for one, some in zip(show.segments, radii, strict=True)
            for size in [np.linalg.norm(some[:, 3 * kind :][:, :3], order, axis=1)]
        ]
        stated = worst(code, limit * turn, unit, seen)
        note = "a bound on every instant, rounding and clipped controls included"
        found.append(replace(stated, time=None, notes=(note,)))
    return found


def radius(segment: Segment, vehicle: Vehicle) -> FloatArray:
    """Enclose what the controls of all drones of a segment fly in each window.

    It is the greatest |flown - logged| of each state (drones, 12) (SI), infinite where
    nothing is proved.
    """
    found = np.full((segment.goals.shape[0], 12), np.inf)
    # What overflows is infinite or undefined, and then nothing is proved.
    with np.errstate(all="ignore"):
        table = segment.table
        # Each half of an interval that is longer than a window is taken as one.
        if (table.end - table.start).sum() * table.state.shape[1] < _LONG:
            while (beyond := table.end - table.start > WINDOW).any():
                table = _halved(table, beyond)
        for part in table.parts(_AT_ONCE):
            # A window is taken as a drone of its own is.
            of_drone = np.isin(np.arange(part.start.size), part.first[:-1])
            late = np.diff(part.start // WINDOW, prepend=0.0) != 0.0
            places = rows_last(part.state[:, :, :3])
            waits = np.ptp(places, axis=0).max(axis=0) <= STILL
            waits[1:] |= waits[:-1]
            each = np.flatnonzero(of_drone | late | waits)
            first = np.append(each, part.start.size)
            windows = replace(part, drones=np.arange(each.size), first=first)
            radii = _radius(windows, vehicle)
            leap = np.abs(part.state[each, 0] - part.state[each - 1, -1])
            leap[of_drone[each]] = 0.0
            # Drones may hover as often as they like, and creep in between.
            long = np.flatnonzero(of_drone | late)
            radii = np.add.reduceat(radii, np.searchsorted(each, long), axis=0)
            own, all_ = (np.searchsorted(x, part.first[:-1]) for x in (long, each))
            found[part.drones] = np.maximum.reduceat(radii, own, axis=0)
            found[part.drones] += np.add.reduceat(leap, all_, axis=0)
    return found


# Step 1: values in Chebyshev points, and coefficients.
def _points(degree: int) -> FloatArray:
    """Chebyshev points on [0, 1], ends included, shape (degree + 1,)."""
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree))


def _transform(degree: int) -> FloatArray:
    """Matrix from values in the Chebyshev points to Chebyshev coefficients."""
    order = np.arange(degree + 1)
    weight = np.where((order == 0) | (order == degree), 0.5, 1.0)
    matrix = np.cos(np.pi * ((degree - order) * order[:, None] % (2 * degree)) / degree)
    return np.asarray(2.0 / degree * weight[:, None] * matrix * weight)


@lru_cache(maxsize=32)
def _chebyshev(degree: int) -> FloatArray:
    """Matrix from Bernstein to Chebyshev coefficients of polynomials of a degree."""
    if degree == 0:
        return np.ones((1, 1))
    return _transform(degree) @ basis(degree, _points(degree))


@lru_cache(maxsize=32)
def _scheme(state_degree: int, control_degree: int) -> _Scheme:
    """Return everything of step 1 that depends on degrees alone.

    These are N; the bases of states and controls at the nodes; the matrices from values
    there to Chebyshev coefficients of their integral, and of its integral; and the sum
    of absolute values of all factors that go into either, or into logged coefficients:
    rounding is multiplied by it at most.
    """
    # Products of two rates are polynomials of twice their degree.
    degree = max(2 * state_degree, control_degree, 4)
    transform, nodes = _transform(degree), _points(degree)
    # From Chebyshev coefficients to those of the integral from 0 to s.
    sizes = degree + 1, degree + 2
    first, second = (chebint(np.eye(size), lbnd=-1, scl=0.5) for size in sizes)
    size = np.abs(first) @ np.abs(transform)
    gain = 2.0 * (state_degree + 2.0) + size.sum() + (np.abs(second) @ size).sum()
    bases = basis(state_degree, nodes), basis(control_degree, nodes)
    once = first @ transform
    return degree, bases, (once, second @ once), float(gain)


# Step 1: right sides on some mesh intervals.
def _excess(control: FloatArray, vehicle: Vehicle) -> FloatArray:
    """How far coefficients of the squared rotor speeds leave [0, 1], (4, rows)."""
    share = rotor_shares(vehicle)
    speeds = np.einsum("ij,njr->nir", share, control)
    over = np.maximum(speeds.max(axis=0) - 1.0, -speeds.min(axis=0))
    scale = np.einsum("ij,jr->ir", np.abs(share), np.abs(control).max(axis=0))
    # What rounding alone brings about is clipped by nothing.
    return np.asarray(np.where(over > GAMMA * scale, over, 0.0))


def _truncation(
    state: FloatArray, control: FloatArray, mass: float, degree: int
) -> FloatArray:
    """Bound of what interpolation of U1 / m b leaves out, shape (rows,) [m/s²]."""
    parts = []
    for source, columns in ((state, slice(6, 9)), (control, slice(0, 1))):
        order = source.shape[0] - 1
        some = np.abs(np.tensordot(_chebyshev(order), source[:, columns], axes=1))
        # No true coefficient is beyond the computed one and what rounding took.
        some += GAMMA * np.abs(source[:, columns]).max(axis=0)
        parts.append(some)
    angles, thrust = parts
    rho = np.array(_ELLIPSES)[:, None]
    power = rho ** np.arange(max(angles.shape[0], thrust.shape[0]))
    lean = 0.5 * (power - 1.0 / power)[:, : angles.shape[0]]
    imaginary = np.tensordot(lean, angles, axes=1)
    push = np.tensordot(power[:, : thrust.shape[0]], thrust[:, 0], axes=1) / mass
    # Each component of b is a sum of at most two products of three factors.
    most = 2.0 * push * np.cosh(imaginary).prod(axis=1)
    bounds = 4.0 * most * rho**-degree / (rho - 1.0)
    return np.asarray(np.fmin.reduce(bounds, initial=np.inf))


def _sides(
    logged: FloatArray, pushed: FloatArray, vehicle: Vehicle, scheme: _Scheme
) -> tuple[FloatArray, FloatArray]:
    """Right sides of velocity and rates along the ``logged`` states (SI).

    ``pushed`` are the coefficients of the control. Returned are values at the nodes
    (N + 1, 6, rows), and the sum of absolute values of what was added up, (6, rows).
    """
    _, (states, controls), *_ = scheme
    state = np.tensordot(states, logged[:, 6:], axes=1)
    control = np.tensordot(controls, pushed, axes=1)
    turning, coupling = _turning(vehicle), _couplings(vehicle)[:, None]
    value = np.empty((state.shape[0], 6, state.shape[2]))
    thrust = control[:, 0] / vehicle.mass
    value[:, :3] = thrust[:, None] * _direction(state[:, :3])
    value[:, 2] -= vehicle.gravity
    rate = state[:, 3:]
    value[:, 3:] = turning * control[:, 1:]
    value[:, 3:] += coupling * rate[:, _ONE] * rate[:, _OTHER]

    most = np.abs(pushed).max(axis=0)
    angles, rates = np.split(np.abs(logged[:, 6:]).max(axis=0), 2)
    size = np.empty((6, state.shape[2]))
    size[:3] = most[0] / vehicle.mass * (1.0 + angles.sum(axis=0)) + vehicle.gravity
    size[3:] = turning * most[1:] + np.abs(coupling) * rates[_ONE] * rates[_OTHER]
    return value, size


def _direction(angles: FloatArray) -> FloatArray:
    """Body z axis in the show frame for roll, pitch, yaw (nodes, 3, rows)."""
    sine, cosine = np.sin(angles), np.cos(angles)
    s_roll, s_pitch, s_yaw = sine[:, 0], sine[:, 1], sine[:, 2]
    c_roll, c_pitch, c_yaw = cosine[:, 0], cosine[:, 1], cosine[:, 2]
    level = c_roll * s_pitch
    x, y = level * c_yaw + s_roll * s_yaw, level * s_yaw - s_roll * c_yaw
    return np.stack([x, y, c_roll * c_pitch], axis=1)


def _turning(vehicle: Vehicle) -> FloatArray:
    """Angular accelerations by torques, shape (3, 1): f / Ix, f / Iy and 1 / Iz."""
    factor = vehicle.torque_factor
    return np.array([[factor], [factor], [1.0]]) / xyz(vehicle.inertia)[:, None]


def _couplings(vehicle: Vehicle) -> FloatArray:
    """c1, c2 and c3."""
    inertia = xyz(vehicle.inertia)
    return (inertia[[1, 2, 0]] - inertia[[2, 0, 1]]) / inertia


# Step 1: defects.
_FIRST = [3, 4, 5, 9, 10, 11]  # what right sides are integrated to: velocity and rates
_SECOND = [0, 1, 2, 6, 7, 8]  # what these are integrated to: position and angles
_ONE, _OTHER = [1, 0, 0], [2, 2, 1]  # rates whose products turn it about each axis


def _defects(
    table: PieceTable, vehicle: Vehicle, curves: _Pair, error: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Bounds of |y1 - ~y1| and |y2 - ~y2| on each mesh interval, each (6, rows).

    ``curves`` are those of the table; ``error`` (6, rows) is what the right sides
    leave out.
    """
    scheme = _scheme(table.state.shape[1] - 1, table.control.shape[1] - 1)
    width, (state, control) = table.end - table.start, curves
    value, size = _sides(state, control, vehicle, scheme)
    whole = np.abs(state).max(axis=0)
    _, _, integrals, gain = scheme
    rounding = GAMMA * gain
    polynomial, step, off = [], [], []
    for k, matrix in enumerate(integrals):
        power = width ** (k + 1)
        found = np.tensordot(matrix, value, axes=1) * power
        step.append(found.sum(axis=0))
        own = whole[(_FIRST, _SECOND)[k]] + k * width * whole[_FIRST]
        off.append(power * (error + rounding * size) + rounding * own)
        logged = state[:, (_FIRST, _SECOND)[k]]
        terms = logged.shape[0]
        found[:terms] -= np.tensordot(_chebyshev(terms - 1), logged, axes=1)
        polynomial.append(found)
    initial, first = state[0][:, table.first[:-1]], table.first
    none = np.zeros((6, table.drones.size))
    y1 = _sums(first, initial[_FIRST], step[0])
    y2 = _sums(first, initial[_SECOND], width * y1 + step[1])
    late = _sums(first, none, off[0])
    astray = _sums(first, none, width * late + off[1])
    polynomial[0][0] += y1
    # The start's velocity goes on evenly: width * s = width / 2 (T_0 + T_1).
    polynomial[1][0] += y2 + 0.5 * width * y1
    polynomial[1][1] += 0.5 * width * y1
    once, twice = (np.abs(some).sum(axis=0) for some in polynomial)
    return once + late + off[0], twice + astray + width * late + off[1]


def _sums(first: IntArray, start: FloatArray, steps: FloatArray) -> FloatArray:
    """Follow each drone over its intervals: values at the start of each, (6, rows).

    ``start`` (6, drones) are the first ones, ``steps`` (6, rows) what is added on each.
    """
    found = np.roll(steps, 1, axis=1)
    found[:, first[:-1]] = start
    counts = np.diff(first)
    for many in {*counts.tolist()}:
        # Drones with as many intervals are followed together.
        own = first[:-1][counts == many][:, None] + np.arange(many)
        found[:, own] = np.cumsum(found[:, own], axis=2)
    return found


# Steps 2 to 4.
def _radius(table: PieceTable, vehicle: Vehicle) -> FloatArray:
    fine, curves, error = _refined(table, vehicle)
    each, defects = fine.first[:-1], _defects(fine, vehicle, curves, error)
    most = [np.maximum.reduceat(one, each, axis=1) for one in defects]
    width = fine.end - fine.start
    total = np.add.reduceat(width, each)
    hull = np.abs(curves[0][:, 9:]).max(axis=0)
    slopes = np.abs(_couplings(vehicle))[:, None] * (hull[_ONE] + hull[_OTHER] + ETA)
    growth = np.add.reduceat(width * slopes.max(axis=0), each)
    sup = most[0][3:].max(axis=0)
    within = sup * np.exp(growth) <= ETA
    gyroscopic = np.where(within, sup * np.expm1(growth), np.inf)
    angles = most[1][3:] + total * gyroscopic
    # Four rotors at full speed: clipped controls ask for no more.
    push = 4.0 * vehicle.thrust_coefficient * vehicle.rotor_speed_max**2 / vehicle.mass
    lean = total * push * angles.sum(axis=0)
    position = most[1][:3] + 0.5 * total * lean
    velocity, rates = most[0][:3] + lean, most[0][3:] + gyroscopic
    found = np.concatenate([position, velocity, angles, rates]).T
    # Sums of positive numbers, each off by rounding alone.
    found *= 1.0 + GAMMA
    return np.where(np.isfinite(found), found, np.inf)


def _refined(
    table: PieceTable, vehicle: Vehicle
) -> tuple[PieceTable, _Pair, FloatArray]:
    """Halve intervals on which step 1 would be coarse.

    Also returns states and controls with rows last, and what interpolation and clipping
    leave out of the right sides at every instant, shape (6, rows) (SI).
    """
    degree, *_ = _scheme(table.state.shape[1] - 1, table.control.shape[1] - 1)
    most, halvings = table.start.size + _MORE, 0
    while True:
        state, control = rows_last(table.state), rows_last(table.control)
        rest = _truncation(state, control, vehicle.mass, degree)
        over = _excess(control, vehicle)
        coarse = ~(rest <= _FINE) | (over.max(axis=0) > _CLIPPED)
        if not coarse.any() or coarse.size > most or halvings == _HALVINGS:
            off = np.abs(allocation(vehicle)) @ over
            thrust = rest + off[:1] / vehicle.mass
            error = np.concatenate([*[thrust] * 3, _turning(vehicle) * off[1:]])
            return table, (state, control), error
        table, halvings = _halved(table, coarse), halvings + 1


def _halved(table: PieceTable, chosen: BoolArray) -> PieceTable:
    """Write the same polynomials with the chosen intervals in two halves."""
    count = 1 + chosen
    first = np.append(0, np.cumsum(count))
    row, left = np.repeat(np.arange(chosen.size), count), first[:-1][chosen]
    start, end = table.start[row], table.end[row]
    start[left + 1] = end[left] = 0.5 * (start[left] + end[left])
    state, control = table.state[row], table.control[row]
    for whole in (state, control):
        whole[left], whole[left + 1] = halves(whole[left])
    return PieceTable(table.drones, first[table.first], start, end, state, control)
