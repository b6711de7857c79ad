"""What a person wants to know about each leg: times, nearest pair, greatest values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.flight import Encounter
from showc.log import showc_pb2 as pb

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.arrays import FloatArray, IntArray
    from showc.log.reader import LoggedSegment, LoggedShow


SEARCH_RATE = 5.0
"""How often the samples are searched for the nearest pair [Hz]."""


@dataclass(frozen=True, slots=True)
class Digest:
    """One leg in a few numbers."""

    segment: LoggedSegment
    """The leg itself."""
    speed: float
    """Greatest speed of any drone [m/s]."""
    tilt: float
    """Greatest |roll| or |pitch| of any drone [rad]."""
    thrust: tuple[float, float]
    """Least and greatest thrust of any drone [N]."""
    closest: Encounter | None
    """Nearest pair: the certificate's, or one that the samples show nearer."""

    @property
    def moving(self) -> bool:
        """Whether it is more than a hold."""
        return self.segment.kind != "hold"

    @property
    def bound(self) -> float | None:
        """No common time can be less [s]; None where nothing is proven."""
        bound = float(self.segment.message.certificate.dual_bound)
        return bound if bound > 0.0 else None

    @property
    def airframe_bound(self) -> float | None:
        """No time can be less for the airframe alone [s]; None where it is not said."""
        found = self.segment.message.certificate.statistics
        return found.get("airframe_bound")

    @property
    def passing(self) -> tuple[int, int, float] | None:
        """Two drones, from 1, and what they need to pass each other [s]."""
        said = self.segment.message.certificate.statistics
        if "passing_bound" not in said:
            return None
        pair = said.get("passing_drone", 0.0), said.get("passing_other", 0.0)
        return int(pair[0]), int(pair[1]), said["passing_bound"]

    @property
    def gap(self) -> float | None:
        """Duration over the greatest single-drone minimum, minus one."""
        least = float(self.segment.message.certificate.single_drone_minimum)
        return self.segment.duration / least - 1.0 if least > 0.0 else None


def tilt_angles(samples: NDArray[np.void]) -> FloatArray:
    """Greater of |roll| and |pitch| [rad] of each sample, from its quaternion."""
    x, y, z, w = (samples[name].astype(np.float64) for name in ("qx", "qy", "qz", "qw"))
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    return np.maximum(np.abs(roll), np.abs(pitch))


def speeds(samples: NDArray[np.void]) -> FloatArray:
    """Speed [m/s] of each sample."""
    velocity = [samples[name].astype(np.float64) for name in ("vx", "vy", "vz")]
    return np.asarray(np.sqrt(sum(component**2 for component in velocity)))


def metric_scale(separation: pb.Separation) -> FloatArray:
    """Factors on (x, y, z) that turn the separation's ellipsoid into a sphere, (3,)."""
    scale = np.ones(3)
    if separation.shape == pb.Separation.ELLIPSOID:
        scale[2] = 1.0 / separation.vertical_stretch
    return scale


def digest(logged: LoggedShow) -> tuple[Digest, ...]:
    """Sum up every leg of a show."""
    return tuple(_digest_one(logged, segment) for segment in logged.segments)


def tightest(digests: tuple[Digest, ...]) -> Encounter | None:
    """Return the nearest pair of the whole show; None for a single drone."""
    found = [d.closest for d in digests if d.closest is not None]
    return min(found, key=lambda closest: closest.distance, default=None)


def _digest_one(logged: LoggedShow, segment: LoggedSegment) -> Digest:
    end = segment.start + segment.duration
    first, last = np.searchsorted(logged.times, [segment.start - 1e-9, end + 1e-9])
    samples = logged.samples[first:last, segment.drones]
    if segment.kind == "hold":
        # Nothing moves: one step tells all, its controls aside.
        samples = samples[:1]
    speed, tilt, low, high = 0.0, 0.0, np.inf, 0.0
    # Some steps at a time: a great fleet's angles would fill the memory.
    for part in np.array_split(samples, max(1, samples.size // 500_000)):
        if part.size:
            speed = max(speed, float(speeds(part).max()))
            tilt = max(tilt, float(tilt_angles(part).max()))
            low = min(low, float(part["u0"].min()))
            high = max(high, float(part["u0"].max()))
    return Digest(
        segment, speed, tilt, (min(low, high), high), _closest(logged, segment)
    )


def _closest(logged: LoggedShow, segment: LoggedSegment) -> Encounter | None:
    candidates = []
    certificate = segment.message.certificate
    if certificate.HasField("closest"):
        pair = certificate.closest
        a, b = sorted((pair.drone_a, pair.drone_b))
        time = segment.start + pair.time
        candidates.append(Encounter(a, b, time, pair.distance))
    sampled = _closest_sampled(logged, segment)
    if sampled is not None:
        candidates.append(sampled)
    return min(candidates, key=lambda closest: closest.distance, default=None)


def _closest_sampled(logged: LoggedShow, segment: LoggedSegment) -> Encounter | None:
    """Nearest pair at some of the samples; None where the metric is no distance."""
    end = segment.start + segment.duration
    first, last = np.searchsorted(logged.times, [segment.start - 1e-9, end + 1e-9])
    stride = max(1, round(logged.rules.log_rate / SEARCH_RATE))
    steps = range(first, last, stride) if segment.kind != "hold" else [first]
    best = None
    for step in steps:
        place = logged.positions[step, segment.drones]
        one = nearest_at(place, float(logged.times[step]), logged.rules.separation)
        if one is not None and (best is None or one.distance < best.distance):
            a, b = segment.drones[[one.drone_a, one.drone_b]].tolist()
            best = Encounter(a, b, one.time, one.distance)
    return best


def nearest_at(
    place: FloatArray, time: float, separation: pb.Separation
) -> Encounter | None:
    """Nearest pair of places (n, 3) [m]; None where the metric is no distance."""
    from scipy.spatial import cKDTree  # noqa: PLC0415  # only pictures need it

    if separation.shape == pb.Separation.ALL_AXES or len(place) < 2:
        return None
    order = np.inf if separation.shape == pb.Separation.ANY_AXIS else 2
    scaled = place * metric_scale(separation)
    distance, index = cKDTree(scaled).query(scaled, k=2, p=order)
    nearest = int(distance[:, 1].argmin())
    # Of two drones in one place, the tree may name either first.
    a, b = sorted({int(i) for i in index[nearest]} | {nearest})[:2]
    return Encounter(a, b, time, float(distance[nearest, 1]))


def every(logged: LoggedShow, stride: int) -> IntArray:
    """Return each ``stride``-th step of the log's grid, and the last step of all."""
    steps = np.arange(0, logged.times.size, stride)
    last = logged.times.size - 1
    return steps if steps[-1] == last else np.append(steps, last)


def stride_within(logged: LoggedShow, budget: int) -> int:
    """Return the least stride that leaves at most ``budget`` samples of the log."""
    return max(1, -(-logged.samples.size // budget))
