"""What segments claim: lower bounds on their times, and their closest encounters.

**Theorem.** Where :func:`refuted` is true, no flight within the segment's limits makes
the way of the witness's drone, from its state at the start to that at the end, in the
witness's time or less.

Proof. A time s after a roll f with the rate f', roll is at most ``f + max(f', 0) s +
c(s)``: with a the greatest angular acceleration and w the greatest rate, c(s) is
a s² / 2 until a s = w, then w s - w² / (2 a). The least roll is alike, and so are
pitch, and a time s before an end, with the rate turned round; the tilt limit holds
besides. Thrust over mass times the body z axis is then, at t after the start and T - t
before the end, a point of the set U(t), and the velocity a point of the box V of its
limits. For any constant beta and any continuous, piecewise linear lambda, integrating
x' = v and v' = u - g e_z by parts gives

    beta . d + lambda(T) . v(T) - lambda(0) . v(0)
             = integral of (beta + lambda') . v + lambda . (u - g e_z)
            <= integral of h_V(beta + lambda') + h_U(t)(lambda) - g lambda_z,

h being the support functions and d the way. Where the left side is the greater, no
flight takes that time T. Nor a shorter one, q T with 0 < q < 1: on the same fractions
of it, take q lambda. U(q t) lies in U(t), for the caps widen with time, so the left
side is greater by F(q) = beta . d + q a - q² b or more, a being constant and b a bound
of the integral of h_U(lambda) - g lambda_z. Where b is not negative, F is concave: it
is positive between 0 and 1 as it is at both, beta . d being positive.

Where jerk is at most j, a = u - g e_z is continuous, and 0 at hovers: for any such mu,
0 at other ends, the integral of mu' . a + mu . a' vanishes, and mu . a' <= j |mu|. Then
lambda + mu' stands for lambda beside u and g, and the integral of j |mu| is added on
the right: by convexity the trapezoid rule is not below it. It adds -q³ c to F, c >= 0.

Where accelerations are limited, u also lies in a cone within a cylinder: |u_x| <= p
u_z, |u_y| <= q u_z, p and q by the caps on lambda's side, u_x² + u_y² <= r², low <=
u_z <= high. At height z the best level part is x a + y b, (a, b) in a rectangle cut by
a disc, a concave function of z: x p z + y q z while the corner lies in the disc,
r |(x, y)| while the disc's own point lies in the rectangle, else x p z + y
sqrt(r² - p² z²) or the same with axes changed. So the best z is an end, a change of
form, or where the slope of a form vanishes. The least of both support functions bounds
``lambda . u``.

The integral is rounded upward: on each cell the caps are taken at their greatest, h_U
is convex in lambda and lambda linear, so the trapezoid rule is not below the integral.

A claimed encounter is the distance of two polynomials at one instant, right to rounding
far below its tolerance.

*Rounding.* Each value of a support function is right to 100 u of the sizes of what goes
into it; a sum of n of them adds n u (Higham 2002, Accuracy and Stability of Numerical
Algorithms, section 3.1): the left side must exceed the right one by gamma_m of all
sizes, m being the number of cells and knots plus 200.

Source: weak duality for a relaxed optimal control problem (Vinter 1993, Convex duality
and nonlinear optimal control, SIAM J. Control Optim. 31); its proof stands above.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.verify.kernel.choreography import AT_REST, JOINT
from showc.verify.kernel.show import LoggedShow, Seen, Segment, Statement, worst, xyz
from showc.verify.kernel.slices import Tracks, measures

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray
    from showc.log.showc_pb2 import Limits, Rules
    from showc.log.showc_pb2 import Segment as SegmentMessage
    from showc.verify.kernel.separation import Encounter

CELLS = 512  # between two knots: eight times as many prove 1 % more

_AT_ONCE = 16  # knots: few enough for their cells to stay in the processor's cache

UNIT = 2.0**-53  # unit roundoff u of float64

TOLERANCE = 1e-6  # how far a claimed bound may lie above the time of its witness [s]

DISTANCE_TOLERANCE = 1e-3
"""How far a claimed closest encounter may be from the distance at its time [m]."""


class Relaxed:
    """What a drone can do at most: its support functions."""

    def __init__(self, rules: Rules, limits: Limits) -> None:
        vehicle = rules.vehicle
        squared = vehicle.thrust_coefficient * vehicle.rotor_speed_max**2
        self.gravity = vehicle.gravity
        self.least = limits.thrust_min / vehicle.mass
        self.most = min(limits.thrust_max, 4.0 * squared) / vehicle.mass
        self.slowest, self.fastest = xyz(limits.velocity_min), xyz(limits.velocity_max)
        self.tilt, self.rate = limits.tilt, xyz(limits.body_rate)
        self.held, self.heading = rules.yaw_held, rules.heading
        inertia = xyz(vehicle.inertia)
        torque = np.minimum(xyz(limits.torque_max)[:2], squared * vehicle.arm_length)
        turn = vehicle.torque_factor * torque / inertia[:2]
        if not self.held:
            # Gyroscopic moments; with yaw held r is zero and they vanish.
            lever = np.abs([inertia[1] - inertia[2], inertia[2] - inertia[0]])
            turn = turn + lever / inertia[:2] * self.rate[[1, 0]] * self.rate[2]
        self.acceleration = turn
        self.level_speed = limits.level_speed or np.inf
        self.cylinder = self._cylinder(limits)

    def _cylinder(self, limits: Limits) -> tuple[float, float, float] | None:
        """Greatest level thrust, least and greatest vertical thrust [m/s²]."""
        up, down = limits.acceleration_up, limits.acceleration_down
        if not (limits.acceleration or up or down):
            return None
        level = min(limits.acceleration or self.most, self.most)
        upright = np.cos(self.tilt) ** 2
        # What thrust there is at least and does not go level goes up.
        rest = np.sqrt(max(self.least**2 - level**2, 0.0))
        low = max(self.least * upright, rest, self.gravity - (down or np.inf))
        return level, low, min(self.most, self.gravity + (up or np.inf))

    def caps(
        self, after: FloatArray, before: FloatArray, ends: FloatArray
    ) -> list[FloatArray]:
        """Least and greatest roll, and pitch (2, ...), so long [s] from the ends."""
        found = []
        for axis in (0, 1):
            rate, acceleration = self.rate[axis], self.acceleration[axis]
            ramp = rate / acceleration
            caps = np.full((2, *after.shape), self.tilt)
            for since, end, sign in ((after, ends[0], 1.0), (before, ends[1], -1.0)):
                turned = rate * since - 0.5 * rate * ramp
                swing = np.where(since < ramp, 0.5 * acceleration * since**2, turned)
                for cap, side in zip(caps, (-1.0, 1.0), strict=True):
                    angle = side * end[6 + axis]
                    speed = max(side * sign * end[9 + axis], 0.0)
                    cap[:] = np.minimum(cap, angle + speed * since + swing)
            found.append(caps * np.array([-1.0, 1.0]).reshape(2, *[1] * after.ndim))
        return found

    def velocity_support(self, direction: FloatArray) -> FloatArray:
        """Greatest ``direction . v``; (..., 3) to (...)."""
        best = np.maximum(direction * self.slowest, direction * self.fastest)
        box = np.asarray(best.sum(axis=-1))
        if not np.isfinite(self.level_speed):
            return box
        level = self.level_speed * np.hypot(direction[..., 0], direction[..., 1])
        return np.asarray(np.minimum(box, level + best[..., 2]))

    def thrust_supports(
        self, direction: FloatArray, roll: FloatArray, pitch: FloatArray
    ) -> list[FloatArray]:
        """Greatest ``direction . u`` over each set that u lies in; (..., 3) to (...).

        Roll and pitch lie between their caps (2, ...).

        With yaw held, u over its length is (cos phi sin theta, -sin phi, cos phi cos
        theta) in the frame of the heading: the best pitch first, then the best roll.
        With yaw free, u lies within the cone of tilt arccos(cos phi cos theta).
        """
        x, y, up = direction[..., 0], direction[..., 1], direction[..., 2]
        most_roll, most_pitch = np.abs(roll).max(axis=0), np.abs(pitch).max(axis=0)
        if self.held:
            cosine, sine = np.cos(self.heading), np.sin(self.heading)
            ahead, left = cosine * x + sine * y, cosine * y - sine * x
            length = _within(_within(up, ahead, pitch), -left, roll)
        else:
            cone = np.arccos(np.clip(np.cos(most_roll) * np.cos(most_pitch), -1.0, 1.0))
            length = _within(up, np.hypot(x, y), np.stack([-cone, cone]))
        found = [np.where(length > 0.0, self.most * length, self.least * length)]
        if self.cylinder is not None:
            level, low, high = self.cylinder
            if self.held:
                lean = np.maximum(np.where(left > 0.0, -roll[0], roll[1]), 0.0)
                tip = np.maximum(np.where(ahead > 0.0, pitch[1], -pitch[0]), 0.0)
                slopes = np.tan(tip), np.tan(lean) / np.cos(most_pitch)
            else:
                ahead, left = np.hypot(x, y), 0.0 * x
                slopes = np.tan(cone), 0.0 * cone
            ends = np.full_like(up, low), np.full_like(up, high)
            turned = np.abs(ahead), np.abs(left), up
            found.append(_within_cylinder(turned, slopes, level, ends))
        return found


def _within_cylinder(
    direction: tuple[FloatArray, FloatArray, FloatArray],
    slopes: tuple[FloatArray, FloatArray],
    radius: float,
    ends: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Greatest ``direction . u`` over the cone within the cylinder; see above.

    Of the direction x and y are at least 0; slopes are p and q, ``radius`` is r, ends
    are the least and the greatest u_z [m/s²], each (...).
    """
    (x, y, up), (p, q), size = direction, slopes, np.hypot(*direction[:2])
    with np.errstate(divide="ignore", invalid="ignore"):
        heights = [
            *ends,
            radius / np.hypot(p, q),
            radius * x / (size * p),
            radius * y / (size * q),
            radius * (x * p + up) / (p * np.hypot(x * p + up, y * p)),
            radius * (y * q + up) / (q * np.hypot(y * q + up, x * q)),
        ]
    best = np.full_like(size, -np.inf)
    for height in heights:
        z = np.fmin(np.fmax(height, ends[0]), ends[1])
        a, b = np.minimum(p * z, radius), np.minimum(q * z, radius)
        # The rectangle's corner, cut back to the disc along either side.
        along_a = x * a + y * np.minimum(b, np.sqrt(radius**2 - a**2))
        along_b = y * b + x * np.minimum(a, np.sqrt(radius**2 - b**2))
        own = (radius * x <= a * size) & (radius * y <= b * size)
        level = np.where(own, radius * size, np.maximum(along_a, along_b))
        best = np.maximum(best, up * z + level)
    return np.asarray(best)


def _within(along: FloatArray, across: FloatArray, caps: FloatArray) -> FloatArray:
    """Greatest ``along cos a + across sin a`` for a between caps, |a| < pi / 2."""
    best = np.clip(np.arctan2(across, along), *caps)
    angles = np.stack([*np.broadcast_arrays(*caps, best)])
    return np.asarray((along * np.cos(angles) + across * np.sin(angles)).max(axis=0))


def refuted(
    message: SegmentMessage, rules: Rules, way: FloatArray, ends: FloatArray
) -> bool:
    """Whether the segment's witness proves its drone's move impossible in its time.

    The witness in ``message`` has T [s], beta, knots (k,) as fractions of T, and
    multipliers (k, 3): lambda; where jerk is limited (k, 6): lambda, mu. Its drone
    flies ``way`` (3,) [m] between ``ends`` (2, 12), its states at start and end.
    """
    witness, beta = message.certificate.witness, xyz(message.certificate.witness.beta)
    knots, time = np.array(witness.knots), witness.time
    multipliers = np.array(witness.multipliers)
    limits = rules.limits[message.limits]
    relaxed, each = Relaxed(rules, limits), 6 if limits.jerk > 0.0 else 3
    if not (
        knots.size >= 2
        and multipliers.size == each * knots.size
        and np.isfinite([*multipliers, *beta, time]).all()
        and (knots[0], knots[-1]) == (0.0, 1.0)
        and np.all(np.diff(knots) > 0.0)
        and time > 0.0
        and relaxed.tilt < 0.5 * np.pi
    ):
        return False
    multipliers, turns = np.split(multipliers.reshape(-1, each), [3], axis=1)
    instants = knots * time
    widths = np.diff(instants)
    slope = np.diff(multipliers, axis=0) / widths[:, None]
    cruise = float(relaxed.velocity_support(beta + slope) @ widths)
    shift, lengths = np.zeros((widths.size, 3)), np.linalg.norm(turns, axis=1)
    shift[:, : turns.shape[1]] = np.diff(turns, axis=0) / widths[:, None]
    if lengths[[0, -1]][np.abs(ends[:, AT_REST]).max(axis=1) > JOINT].any():
        return False
    turning = 0.5 * limits.jerk * float((lengths[:-1] + lengths[1:]) @ widths)
    middle = 0.5 * (multipliers[:-1, 2] + multipliers[1:, 2]) + shift[:, 2]
    weight = relaxed.gravity * float(middle @ widths)
    thrust, edge = 0.0, np.arange(CELLS + 1) / CELLS
    for k in (slice(m, m + _AT_ONCE) for m in range(0, widths.size, _AT_ONCE)):
        at = instants[:-1][k, None] + widths[k, None] * edge
        step = np.diff(multipliers, axis=0)[k, None]
        vector = (multipliers[:-1] + shift)[k, None] + edge[:, None] * step
        low, high = at[:, :-1], at[:, 1:]
        # The moments of the cell that are furthest from the ends have the widest caps.
        roll, pitch = relaxed.caps(high, time - low, ends)
        before = relaxed.thrust_supports(vector[:, :-1], roll, pitch)
        after = relaxed.thrust_supports(vector[:, 1:], roll, pitch)
        # Each is convex, their least is not: it is taken after the trapezoids.
        heights = np.min(np.add(before, after), axis=0)
        thrust += 0.5 / CELLS * float(widths[k] @ heights.sum(axis=1))
    sizes = np.abs(multipliers[:-1]) + np.abs(multipliers[1:]) + 2.0 * np.abs(shift)
    size = float(widths @ sizes.sum(axis=1))
    gain, speeds = float(beta @ way), ends[:, 3:6]
    swing = float(multipliers[-1] @ speeds[1] - multipliers[0] @ speeds[0])
    # No thrust is greater than the greatest, no speed than that of the box's corner.
    fastest = np.maximum(np.abs(relaxed.slowest), np.abs(relaxed.fastest))
    size *= 2.0 * (relaxed.most + relaxed.gravity)
    size += float(np.abs(beta) @ np.abs(way)) + turning
    size += float((np.abs(multipliers[[0, -1]]) * np.abs(speeds)).sum())
    size += float(((np.abs(beta) + np.abs(slope)) @ fastest) @ widths)
    steps = (CELLS + knots.size + 200) * UNIT
    excess = min(gain, gain + swing - (cruise + thrust - weight + turning))
    return bool(thrust >= weight and excess > steps / (1.0 - steps) * size)


def certified(segments: Sequence[Segment], beyond: Sequence[float]) -> list[Statement]:
    """State what claimed bounds are worth; :func:`excess` of each is given."""
    bounds, order = [], []
    for one, late in zip(segments, beyond, strict=True):
        said = one.message.certificate
        if said.dual_bound or said.HasField("witness"):
            bounds.append(_seen(one, said.witness.drone, late))
        # Bound <= greatest single-drone minimum <= time flown.
        single = said.single_drone_minimum or one.duration
        over = single - one.duration if 0.0 <= said.dual_bound <= single else np.inf
        order.append(_seen(one, 0, over))
    both = ("VRF341", bounds), ("VRF342", order)
    return [worst(code, TOLERANCE, "s", found) for code, found in both]


def closest_claims(
    show: LoggedShow, encounters: Sequence[Encounter | None]
) -> Statement:
    """State whether claimed encounters are the closest, which are given."""
    found = []
    for one, near in zip(show.segments, encounters, strict=True):
        said = one.message.certificate
        if near is not None or said.HasField("closest"):
            off = np.inf if near is None else _off(show, one, near)
            found.append(_seen(one, said.closest.drone_a, off))
    return worst("VRF343", DISTANCE_TOLERANCE, "m", found)


def _seen(segment: Segment, drone: int, value: float) -> Seen:
    name, values = segment.message.name, np.array([max(value, 0.0)])
    return Seen(name, segment.start, np.array([drone]), values)


def excess(show: LoggedShow, segment: Segment) -> float:
    """By how much a claimed bound is beyond what its witness proves [s]."""
    certificate, proved = segment.message.certificate, False
    witness = certificate.witness
    own = np.flatnonzero(segment.table.drones == witness.drone)
    if certificate.HasField("witness") and own.size:
        ends = np.concatenate([states[own] for states in segment.ends()])
        way = segment.goals[own[0]] - ends[0, :3]
        proved = refuted(segment.message, show.rules, way, ends)
    return certificate.dual_bound - witness.time if proved else np.inf


def _off(show: LoggedShow, segment: Segment, nearest: Encounter) -> float:
    """How far a claimed distance is off the closest, and off the one then [m]."""
    closest = segment.message.certificate.closest
    pair = np.array([closest.drone_a, closest.drone_b])
    known = pair[0] != pair[1] and pair.max() < show.drones
    if not (known and 0.0 <= closest.time <= segment.duration + 1e-9):
        return np.inf
    time = np.full(2, segment.start + closest.time)
    tracks = Tracks.of(segment)
    place = tracks.between(tracks.at(pair, time), time, time)[:, 0]
    both = [m(m.space(place[1] - place[0])) for m in measures(show.rules.separation)]
    said = [float(min(both)), nearest.upper]
    return float(np.abs(np.subtract(said, closest.distance)).max())
