"""Problems that strangers try first: from textbooks and other tools' example folders.

Most have optima in closed form, the others agree in several published sources to the
digits given. They are stated as a newcomer would: no scales, no guesses, no mesh.
"""

from __future__ import annotations

from math import acos, atan, cos, pi, sin, sqrt, tanh

import casadi as ca
from benchmarks.ocp_problems import Benchmark
from scipy.optimize import brentq

from showc import ocp


def aly_chan() -> ocp.Problem:
    """Aly, Chan 1973: singular all along, u = -sin t."""
    problem = ocp.Problem("aly_chan")
    phase = problem.phase(duration=pi / 2.0)
    x = phase.state("x", start=0.0)
    y = phase.state("y", start=1.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, y)
    phase.derivative(y, u)
    problem.minimise(1.0 + phase.integral(0.5 * (y**2 - x**2)))
    return problem


def bressan() -> ocp.Problem:
    """Bressan, Piccoli 2007: at the bound to T/3, then singular with u = 1/2."""
    problem = ocp.Problem("bressan")
    phase = problem.phase(duration=10.0)
    x = phase.state("x", start=0.0)
    y = phase.state("y", start=0.0)
    z = phase.state("z", start=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, u)
    phase.derivative(y, -x)
    phase.derivative(z, y - x**2)
    problem.maximise(phase.final(z))
    return problem


def dido() -> ocp.Problem:
    """The greatest area under a rope of length pi/3 over a chord of 1."""
    problem = ocp.Problem("dido")
    phase = problem.phase(duration=1.0)
    y = phase.state("y", start=0.0, end=0.0)
    slope = phase.control("slope")
    phase.derivative(y, slope)
    length = phase.integral(ca.sqrt(1.0 + slope**2))
    problem.constrain_boundary(length, pi / 3.0, pi / 3.0, name="rope")
    problem.maximise(phase.integral(y))
    return problem


def hanging_chain() -> ocp.Problem:
    """COPS 3: least potential energy of a chain of length 4."""
    problem = ocp.Problem("hanging_chain")
    phase = problem.phase(duration=1.0)
    y = phase.state("y", start=1.0, end=3.0)
    length = phase.state("length", start=0.0, end=4.0)
    slope = phase.control("slope")
    phase.derivative(y, slope)
    phase.derivative(length, ca.sqrt(1.0 + slope**2))
    problem.minimise(phase.integral(y * ca.sqrt(1.0 + slope**2)))
    return problem


def steering() -> ocp.Problem:
    """COPS 3, Betts 2010: linear tangent steering."""
    problem = ocp.Problem("steering")
    phase = problem.phase(duration=(0.01, 10.0))
    x = phase.state("x", start=0.0)
    y = phase.state("y", start=0.0, end=5.0)
    vx = phase.state("vx", start=0.0, end=45.0)
    vy = phase.state("vy", start=0.0, end=0.0)
    angle = phase.control("angle", -pi / 2.0, pi / 2.0)
    phase.derivative(x, vx)
    phase.derivative(y, vy)
    phase.derivative(vx, 100.0 * ca.cos(angle))
    phase.derivative(vy, 100.0 * ca.sin(angle))
    problem.minimise(phase.duration)
    return problem


def batch_reactor() -> ocp.Problem:
    """Ray 1981; Logsdon, Biegler 1989: A to B to C, most of B."""
    problem = ocp.Problem("batch_reactor")
    phase = problem.phase(duration=1.0)
    a = phase.state("a", start=1.0)
    b = phase.state("b", start=0.0)
    u = phase.control("u", 0.0, 5.0)
    phase.derivative(a, -(u + 0.5 * u**2) * a)
    phase.derivative(b, u * a)
    problem.maximise(phase.final(b))
    return problem


def hager() -> ocp.Problem:
    """Hager 2000: smooth, optimum tanh(1)."""
    problem = ocp.Problem("hager")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=1.0)
    u = phase.control("u")
    phase.derivative(x, 0.5 * x + u)
    problem.minimise(phase.integral(u**2 + x * u + 1.25 * x**2))
    return problem


def moon_shot() -> ocp.Problem:
    """Smooth and badly scaled: 384,400 km in 3e5 s, in metres, no bounds given."""
    problem = ocp.Problem("moon_shot")
    phase = problem.phase(duration=3e5)
    x = phase.state("x", start=0.0, end=3.844e8)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u")
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.integral(0.5 * u**2))
    return problem


def speed_limit() -> ocp.Problem:
    """Least effort with a limit on a state of first order: on it for a while."""
    problem = ocp.Problem("speed_limit")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0, end=1.0)
    v = phase.state("v", None, 1.2, start=0.0, end=0.0)
    u = phase.control("u")
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.integral(0.5 * u**2))
    return problem


def sounding_rocket() -> ocp.Problem:
    """Betts 2010: Goddard's rocket in feet and pounds, singular arc."""
    problem = ocp.Problem("sounding_rocket")
    phase = problem.phase(duration=(1.0, 500.0))
    h = phase.state("h", 0.0, 30_000.0, start=0.0)
    v = phase.state("v", 0.0, 3_000.0, start=0.0)
    m = phase.state("m", 1.0, 3.0, start=3.0, end=1.0)
    thrust = phase.control("thrust", 0.0, 193.044)
    drag = 5.49153484923381010e-05 * v**2 * ca.exp(-h / 23_800.0)
    phase.derivative(h, v)
    phase.derivative(v, (thrust - drag) / m - 32.174)
    phase.derivative(m, -thrust / 1580.9425279876559)
    problem.maximise(phase.final(h))
    return problem


def dubins() -> ocp.Problem:
    """Dubins 1957: left, straight, left."""
    problem = ocp.Problem("dubins")
    phase = problem.phase(duration=(0.1, 50.0))
    x = phase.state("x", start=0.0, end=4.0)
    y = phase.state("y", start=0.0, end=4.0)
    heading = phase.state("heading", start=0.0, end=pi / 2.0)
    turn = phase.control("turn", -1.0, 1.0)
    phase.derivative(x, ca.cos(heading))
    phase.derivative(y, ca.sin(heading))
    phase.derivative(heading, turn)
    problem.minimise(phase.duration)
    return problem


def round_a_disc() -> ocp.Problem:
    """Shortest way round a disc: tangent, arc, tangent."""
    problem = ocp.Problem("round_a_disc")
    phase = problem.phase(duration=(0.1, 50.0))
    x = phase.state("x", start=-2.0, end=2.0)
    y = phase.state("y", start=0.5, end=0.5)
    heading = phase.control("heading", -pi, pi)
    phase.derivative(x, ca.cos(heading))
    phase.derivative(y, ca.sin(heading))
    phase.constrain(x**2 + y**2, 1.0, None, name="disc")
    problem.minimise(phase.duration)
    return problem


def _round_a_disc_optimum() -> float:
    tangent = sqrt(4.25 - 1.0)
    angle = pi - 2.0 * atan(0.5 / 2.0) - 2.0 * acos(1.0 / sqrt(4.25))
    return 2.0 * tangent + angle


def refraction() -> ocp.Problem:
    """Least time from air into water, two phases with a free border: Snell's law."""
    problem = ocp.Problem("refraction")
    air = problem.phase("air", duration=(0.01, 20.0))
    water = problem.phase("water", duration=(0.01, 20.0))
    for phase, speed in ((air, 1.0), (water, 0.5)):
        first = phase is air
        x = phase.state("x", start=0.0 if first else None, end=None if first else 1.0)
        y = phase.state("y", start=1.0 if first else 0.0, end=0.0 if first else -1.0)
        heading = phase.control("heading", -pi, 0.0)
        phase.derivative(x, speed * ca.cos(heading))
        phase.derivative(y, speed * ca.sin(heading))
    problem.link(air, water)
    problem.minimise(water.final_time)
    return problem


def _refraction_optimum() -> float:
    def slope(x: float) -> float:
        return x / sqrt(x**2 + 1.0) - 2.0 * (1.0 - x) / sqrt((1.0 - x) ** 2 + 1.0)

    x = brentq(slope, 0.0, 1.0, xtol=1e-15)
    return float(sqrt(x**2 + 1.0) + 2.0 * sqrt((1.0 - x) ** 2 + 1.0))


def two_link_arm() -> ocp.Problem:
    """Luus 2000; Moberg 2000: bang-bang in least time."""
    problem = ocp.Problem("two_link_arm")
    phase = problem.phase(duration=(0.1, 20.0))
    a = phase.state("a", start=0.0, end=0.0)
    b = phase.state("b", start=0.0, end=0.0)
    elbow = phase.state("elbow", start=0.5, end=0.5)
    shoulder = phase.state("shoulder", start=0.0, end=0.522)
    u1, u2 = (phase.control(name, -1.0, 1.0) for name in ("u1", "u2"))
    s, c = ca.sin(elbow), ca.cos(elbow)
    below = 31.0 / 36.0 + 9.0 / 4.0 * s**2
    phase.derivative(
        a,
        (s * (9.0 / 4.0 * c * a**2 + 2.0 * b**2) + 4.0 / 3.0 * (u1 - u2) - 1.5 * c * u2)
        / below,
    )
    phase.derivative(
        b,
        -(
            s * (3.5 * a**2 + 9.0 / 4.0 * c * b**2)
            - 7.0 / 3.0 * u2
            + 1.5 * c * (u1 - u2)
        )
        / below,
    )
    phase.derivative(elbow, b - a)
    phase.derivative(shoulder, a)
    problem.minimise(phase.duration)
    return problem


def reorientation() -> ocp.Problem:
    """Fleming, Sekhavat, Ross 2010; Betts 2010: a spacecraft turned by 150 degrees."""
    problem = ocp.Problem("reorientation")
    phase = problem.phase(duration=(1.0, 100.0))
    half = 75.0 * pi / 180.0
    ends = (sin(half), 0.0, 0.0, cos(half))
    q = [
        phase.state(f"q{i}", -1.1, 1.1, start=float(i == 3), end=ends[i])
        for i in range(4)
    ]
    w = [phase.state(f"w{i}", start=0.0, end=0.0) for i in range(3)]
    u = [phase.control(f"u{i}", -50.0, 50.0) for i in range(3)]
    ix, iy, iz = 5621.0, 4547.0, 2364.0
    phase.derivative(q[0], 0.5 * (w[0] * q[3] - w[1] * q[2] + w[2] * q[1]))
    phase.derivative(q[1], 0.5 * (w[0] * q[2] + w[1] * q[3] - w[2] * q[0]))
    phase.derivative(q[2], 0.5 * (-w[0] * q[1] + w[1] * q[0] + w[2] * q[3]))
    phase.derivative(q[3], 0.5 * (-w[0] * q[0] - w[1] * q[1] - w[2] * q[2]))
    phase.derivative(w[0], u[0] / ix - (iz - iy) / ix * w[1] * w[2])
    phase.derivative(w[1], u[1] / iy - (ix - iz) / iy * w[0] * w[2])
    phase.derivative(w[2], u[2] / iz - (iy - ix) / iz * w[0] * w[1])
    problem.minimise(phase.duration)
    return problem


def jacobson_lele() -> ocp.Problem:
    """Jacobson, Lele 1969: a limit that moves with time."""
    problem = ocp.Problem("jacobson_lele")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0)
    v = phase.state("v", start=-1.0)
    u = phase.control("u")
    phase.derivative(x, v)
    phase.derivative(v, -v + u)
    limit = 8.0 * (phase.time - 0.5) ** 2 - 0.5
    phase.constrain(v - limit, None, 0.0, name="limit")
    problem.minimise(phase.integral(x**2 + v**2 + 0.005 * u**2))
    return problem


def container_crane() -> ocp.Problem:
    """Sakawa, Shindo 1982; Betts 2010."""
    problem = ocp.Problem("container_crane")
    phase = problem.phase(duration=9.0)
    x1 = phase.state("x1", start=0.0, end=10.0)
    x2 = phase.state("x2", start=22.0, end=14.0)
    x3 = phase.state("x3", start=0.0, end=0.0)
    x4 = phase.state("x4", -2.5, 2.5, start=0.0, end=2.5)
    x5 = phase.state("x5", -1.0, 1.0, start=-1.0, end=0.0)
    x6 = phase.state("x6", start=0.0, end=0.0)
    u1 = phase.control("u1", -2.83374, 2.83374)
    u2 = phase.control("u2", -0.80865, 0.71265)
    phase.derivative(x1, x4)
    phase.derivative(x2, x5)
    phase.derivative(x3, x6)
    phase.derivative(x4, u1 + 17.2656 * x3)
    phase.derivative(x5, u2)
    phase.derivative(x6, -(u1 + 27.0756 * x3 + 2.0 * x5 * x6) / x2)
    problem.minimise(phase.integral(0.5 * (x3**2 + x6**2 + 0.01 * (u1**2 + u2**2))))
    return problem


def cart_pole() -> ocp.Problem:
    """Kelly 2017, section 6: swing up with the least effort."""
    problem = ocp.Problem("cart_pole")
    phase = problem.phase(duration=2.0)
    x = phase.state("x", -2.0, 2.0, start=0.0, end=1.0)
    angle = phase.state("angle", start=0.0, end=pi)
    v = phase.state("v", start=0.0, end=0.0)
    rate = phase.state("rate", start=0.0, end=0.0)
    u = phase.control("u", -20.0, 20.0)
    m1, m2, length, g = 1.0, 0.3, 0.5, 9.81
    s, c = ca.sin(angle), ca.cos(angle)
    below = m1 + m2 * s**2
    phase.derivative(x, v)
    phase.derivative(angle, rate)
    phase.derivative(v, (length * m2 * s * rate**2 + u + m2 * g * c * s) / below)
    phase.derivative(
        rate,
        -(length * m2 * c * s * rate**2 + u * c + (m1 + m2) * g * s) / (length * below),
    )
    problem.minimise(phase.integral(u**2))
    return problem


def tunnel_diode() -> ocp.Problem:
    """Rayleigh's problem without constraints (Jacobson, Mayne 1970; Maurer 2000)."""
    problem = ocp.Problem("tunnel_diode")
    phase = problem.phase(duration=2.5)
    x = phase.state("x", start=-5.0)
    y = phase.state("y", start=-5.0)
    u = phase.control("u")
    phase.derivative(x, y)
    phase.derivative(y, -x + y * (1.4 - 0.14 * y**2) + 4.0 * u)
    problem.minimise(phase.integral(u**2 + x**2))
    return problem


def two_phase_schwartz() -> ocp.Problem:
    """Schwartz 1996: degenerate, the optimum is 0; one added to judge relatively."""
    problem = ocp.Problem("schwartz")
    first = problem.phase("first", duration=1.0)
    second = problem.phase("second", duration=1.9)
    for phase in (first, second):
        begins = phase is first
        x = phase.state("x", None, None, start=1.0 if begins else None)
        y = phase.state(
            "y", -0.8 if begins else None, None, start=1.0 if begins else None
        )
        u = phase.control("u", *((-1.0, 1.0) if begins else (-50.0, 50.0)))
        phase.derivative(x, y)
        phase.derivative(y, u - 0.1 * (1.0 + 2.0 * x**2) * y)
        if begins:
            hole = 1.0 - 9.0 * (x - 1.0) ** 2 - ((y - 0.4) / 0.3) ** 2
            phase.constrain(hole, None, 0.0, name="hole")
    problem.link(first, second)
    problem.minimise(1.0 + 5.0 * (second.final(x) ** 2 + second.final(y) ** 2))
    return problem


def long_hypersensitive() -> ocp.Problem:
    """A hundred times as long as the usual one: the answer is the same."""
    problem = ocp.Problem("hypersensitive_1e6")
    phase = problem.phase(duration=1e6)
    x = phase.state("x", start=1.5, end=1.0)
    u = phase.control("u")
    phase.derivative(x, -(x**3) + u)
    problem.minimise(phase.integral(0.5 * (x**2 + u**2)))
    return problem


def short_hypersensitive() -> ocp.Problem:
    """Short enough for an easy mesh, long enough for the same answer."""
    problem = ocp.Problem("hypersensitive_50")
    phase = problem.phase(duration=50.0)
    x = phase.state("x", start=1.5, end=1.0)
    u = phase.control("u")
    phase.derivative(x, -(x**3) + u)
    problem.minimise(phase.integral(0.5 * (x**2 + u**2)))
    return problem


TEXTBOOK = (
    Benchmark("aly_chan", aly_chan, 1.0, 0.0, "closed form"),
    Benchmark("bressan", bressan, 1000.0 / 18.0, 0.0, "closed form"),
    Benchmark("dido", dido, 0.5 * (pi / 3.0 - sqrt(0.75)), 0.0, "circular segment"),
    Benchmark("hanging_chain", hanging_chain, 5.06848, 1e-6, "COPS 3"),
    Benchmark("steering", steering, 0.554570879, 2e-9, "Betts 2010"),
    Benchmark(
        "batch_reactor", batch_reactor, 0.57354505, 1e-8, "Logsdon, Biegler 1989"
    ),
    Benchmark("hager", hager, tanh(1.0), 0.0, "closed form"),
    Benchmark("moon_shot", moon_shot, 6.0 * 3.844e8**2 / 3e5**3, 0.0, "closed form"),
    Benchmark("speed_limit", speed_limit, 7.68, 0.0, "closed form"),
    Benchmark(
        "sounding_rocket", sounding_rocket, 18550.872, 3e-8, "Betts 2010; GPOPS-II"
    ),
    Benchmark("dubins", dubins, sqrt(18.0) + 0.5 * pi, 0.0, "closed form"),
    Benchmark(
        "round_a_disc", round_a_disc, _round_a_disc_optimum(), 0.0, "closed form"
    ),
    Benchmark("refraction", refraction, _refraction_optimum(), 1e-15, "Snell's law"),
    Benchmark("two_link_arm", two_link_arm, 2.9836, 5e-4, "Luus 2000"),
    Benchmark("reorientation", reorientation, 28.6304077, 1e-8, "Betts 2010"),
    Benchmark("jacobson_lele", jacobson_lele, 0.1698, 3e-4, "Jacobson, Lele 1969"),
    Benchmark("container_crane", container_crane, 0.0375194596, 1e-8, "Betts 2010"),
    Benchmark("cart_pole", cart_pole, 58.8, 1e-3, "Kelly 2017"),
    Benchmark("tunnel_diode", tunnel_diode, 29.376, 2e-5, "Jacobson, Mayne 1970"),
    Benchmark("schwartz", two_phase_schwartz, 1.0, 0.0, "closed form"),
    Benchmark(
        "hypersensitive_50",
        short_hypersensitive,
        1.330806904943002,
        1e-15,
        "Hamilton-Jacobi-Bellman quadrature",
    ),
    Benchmark(
        "hypersensitive_1e6",
        long_hypersensitive,
        1.330806904943002,
        1e-15,
        "Hamilton-Jacobi-Bellman quadrature",
    ),
)
