"""Shapes are where geometry says, by measure and not by eye."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from showc.script.formations.evenly import spread_evenly
from showc.script.formations.skeleton import thinned, traced
from showc.script.formations.spacing import closest, spread_apart
from showc.script.formations.svg import contours_of
from showc.script.language.colours import linear_light
from showc.vehicle import Separation


def gaps(points):
    """Distance of each place to its nearest neighbour."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    return distance.min(axis=1)


def test_grid(points):
    places = points("{type: grid, rows: 2, columns: 3, layers: 2, step: [3, 2, 4], "
                    "centre: [1, 2, 30]}", 12)  # fmt: skip
    assert places[0].tolist() == [-2.0, 1.0, 28.0]
    assert places[-1].tolist() == [4.0, 3.0, 32.0]
    assert places[1].tolist() == [1.0, 1.0, 28.0]
    assert places.mean(axis=0).tolist() == [1.0, 2.0, 30.0]


def test_grid_upright_and_not_full(points):
    places = points("{type: grid, columns: 4, plane: front, step: 2}", 10)
    assert len(places) == 10
    assert np.ptp(places[:, 1]) == 0.0
    assert np.ptp(places[:, 0]) == 6.0
    assert np.ptp(places[:, 2]) == 4.0
    assert gaps(places).min() == pytest.approx(2.0)


def test_line(points):
    places = points(
        "{type: line, length: 30, direction: [0, 3, 4], centre: [0, 0, 50]}", 7
    )
    steps = np.diff(places, axis=0)
    assert np.allclose(steps, np.array([0.0, 3.0, 4.0]))
    assert np.allclose(places.mean(axis=0), [0, 0, 50])


@pytest.mark.parametrize("plane", ["horizontal", "front", "side"])
def test_circle(points, plane):
    places = points(
        f"{{type: circle, radius: 5, plane: {plane}, centre: [0, 0, 20]}}", 9
    )
    assert np.allclose(np.linalg.norm(places - [0, 0, 20], axis=1), 5.0)
    assert np.allclose(gaps(places), 10 * math.sin(math.pi / 9))
    flat = {"horizontal": 2, "front": 1, "side": 0}[plane]
    assert np.ptp(places[:, flat]) == 0.0


def test_arc_has_both_ends(points):
    places = points(
        "{type: circle, radius: 10, start: 0, arc: 90, centre: [0, 0, 20]}", 4
    )
    assert np.allclose(places[0], [10, 0, 20])
    assert np.allclose(places[-1], [0, 10, 20])


def test_sphere_is_even(points):
    places = points("{type: sphere, radius: 10, centre: [0, 0, 30]}", 200)
    assert np.allclose(np.linalg.norm(places - [0, 0, 30], axis=1), 10.0)
    area = 4 * math.pi * 100 / 200
    assert gaps(places).min() > 0.75 * math.sqrt(area)
    assert np.allclose(places.mean(axis=0), [0, 0, 30], atol=0.1)


def test_helix(points):
    places = points(
        "{type: helix, radius: 4, height: 12, turns: 1, centre: [0, 0, 20]}", 13
    )
    assert np.allclose(np.hypot(places[:, 0], places[:, 1]), 4.0)
    assert np.allclose(np.diff(places[:, 2]), 1.0)
    assert np.allclose(places[0], [4, 0, 14])
    assert np.allclose(places[3], [0, 4, 17])


def test_helix_of_two_strands(points):
    places = points("{type: helix, strands: 2, centre: [0, 0, 20]}", 10)
    assert np.allclose(places[:5, :2], -places[5:, :2])
    assert np.allclose(places[:5, 2], places[5:, 2])


def test_cube_by_edges(points):
    places = points("{type: cube, size: 6, centre: [0, 0, 20]}", 20)
    around = np.abs(places - [0, 0, 20])
    assert np.all(np.sort(around, axis=1)[:, 1:] == 3.0)  # two at the limit: an edge
    assert np.sum(np.all(around == 3.0, axis=1)) == 8
    assert gaps(places).min() == pytest.approx(3.0)


def test_cube_by_faces(points):
    places = points(
        "{type: cube, draw: faces, size: [4, 6, 8], centre: [0, 0, 20]}", 60
    )
    around = np.abs(places - [0, 0, 20]) / [2, 3, 4]
    assert np.allclose(around.max(axis=1), 1.0)
    assert gaps(places).min() > 0.6 * math.sqrt(208 / 60)


def test_cube_inside(points):
    places = points("{type: cube, draw: inside, size: 8, centre: [0, 0, 20]}", 27)
    assert sorted({round(v, 6) for v in places[:, 0]}) == [-4.0, 0.0, 4.0]
    assert gaps(places).min() == pytest.approx(4.0)


def test_wave(points):
    places = points(
        "{type: wave, rows: 3, columns: 9, step: 2.5, amplitude: 2, wavelength: 20, "
        "centre: [0, 0, 30]}", 27,
    )  # fmt: skip
    assert np.allclose(places[:, 2], 30 + 2 * np.sin(2 * np.pi * places[:, 0] / 20))


def test_points_are_taken_as_they_are(points):
    places = points("{type: points, points: [[1, 2, 30], [4, 5, 36 ft]]}", 2)
    assert np.allclose(places, [[1, 2, 30], [4, 5, 10.9728]])


@pytest.mark.parametrize("draw", ["centreline", "outline", "inside"])
def test_text(points, draw):
    places = points(
        f"{{type: text, text: HI, height: 14, draw: {draw}, centre: [0, 0, 30]}}", 40
    )
    assert len(places) == 40
    assert np.ptp(places[:, 1]) == 0.0
    assert 11.0 < np.ptp(places[:, 2]) <= 14.0
    # H: two uprights and a bar; I: one upright. All left of, right of, or between.
    columns = np.histogram(places[:, 0], bins=12)[0]
    assert columns[0] >= 6 and columns[-1] >= 6
    assert gaps(places).min() > {"centreline": 1.0, "outline": 1.0, "inside": 1.0}[draw]


def test_letters_are_written_on_the_middle_of_their_strokes(points):
    inside = points("{type: text, text: I, height: 10, draw: inside}", 200)
    middle = points("{type: text, text: I, height: 10}", 8)
    assert np.allclose(middle[:, 0], inside[:, 0].mean(), atol=0.1)
    steps = np.diff(np.sort(middle[:, 2]))
    assert steps.max() < 1.35 * steps.min()


@pytest.mark.parametrize("text", ["a", "8", "O", "@", "B&", "R2D2", "%", "="])
@pytest.mark.parametrize("drones", [5, 24, 80])
def test_letters_with_rings_and_branches_have_room(points, text, drones):
    places = points(f'{{type: text, text: "{text}", height: 30}}', drones)
    assert len(places) == drones
    assert gaps(places).min() > 0.35 * np.median(gaps(places))


def test_lines_of_text_stand_below_each_other(points):
    one = points('{type: text, text: "A\\nB", height: 20, centre: [0, 0, 40]}', 60)
    heights = np.sort(one[:, 2])
    assert np.diff(heights).max() > 1.5  # the gap between the lines


SVG = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100">
<g transform="translate(10 0)">
<rect x="0" y="0" width="40" height="80" fill="none" stroke="red"/>
<circle cx="80" cy="40" r="20" fill="#0000ff"/>
</g></svg>"""


def test_svg(show, tmp_path):
    (tmp_path / "logo.svg").write_text(SVG, encoding="utf-8")
    made = show(
        "drones: 60\nseparation: 0.1\nformations:\n"
        "  logo: {type: svg, file: logo.svg, height: 8, centre: [0, 0, 20]}\n"
        "transitions: [logo]\n"
    )
    logo = made.formations["logo"]
    assert made.source.inputs == {"logo.svg": SVG.encode()}
    red = logo.colours[:, 0] > 0.9
    # The rectangle's outline is 240 long, the circle's 40 pi; y points down in SVG.
    assert red.sum() == round(60 * 240 / (240 + 40 * math.pi))
    assert np.allclose(logo.colours[~red], [0, 0, 1])
    right = logo.points[~red]
    middle = (right.max(axis=0) + right.min(axis=0)) / 2
    radius = np.hypot(right[:, 0] - middle[0], right[:, 2] - middle[2])
    assert np.allclose(radius, 2.0, atol=0.05)
    assert np.ptp(logo.points[red][:, 2]) == pytest.approx(8.0, abs=0.3)


@pytest.mark.parametrize(
    ("body", "widths"),
    [
        ('<mask><circle r="4"/></mask><rect width="1" height="1"/>', [1]),
        ('<marker><circle r="4"/></marker><rect width="1" height="1"/>', [1]),
        ('<pattern><circle r="4"/></pattern><rect width="1" height="1"/>', [1]),
        # A symbol is drawn where it is used, and only there.
        ('<symbol id="s"><circle r="4"/></symbol><use href="#s"/>', [8]),
        ('<mask><circle id="s" r="4"/></mask><use href="#s" x="3"/>', [8]),
        ('<g transform="scale(0)"><rect width="5" height="3"/></g>', []),
        ('<rect transform="matrix(1 1 1 1 0 0)" width="5" height="3"/>', []),
        ('<rect transform="scale(-1 2)" width="5" height="3"/>', [5]),
        ('<rect width="-5" height="3"/><circle r="-2"/>', []),
        ('<ellipse rx="4" ry="-1"/><ellipse rx="4" ry="1"/>', [8]),
        ('<g visibility="collapse"><circle r="4"/></g>', []),
    ],
)
@pytest.mark.parametrize("space", ['xmlns="http://www.w3.org/2000/svg"', ""])
def test_svg_draws_what_a_renderer_draws(body, widths, space):
    content = f'<svg {space} viewBox="0 0 100 100">{body}<path d="M0 0h9"/></svg>'
    found = contours_of(content.encode(), "it.svg")
    spans = [float(np.ptp(one.points[:, 0])) for one in found]
    assert spans == pytest.approx([*widths, 9])


def test_svg_filled(show, tmp_path):
    (tmp_path / "logo.svg").write_text(SVG, encoding="utf-8")
    made = show(
        "drones: 60\nseparation: 0.1\nformations:\n  logo: {type: svg, file: logo.svg, "
        "height: 8, draw: inside, centre: [0, 0, 20]}\ntransitions: [logo]\n"
    )
    logo = made.formations["logo"]
    red = logo.colours[:, 0] > 0.9
    # 3200 and 400 pi units of area.
    assert abs(red.sum() - 60 * 3200 / (3200 + 400 * math.pi)) <= 4


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("bare.csv", "0,0,20\n3,0,20\n6,0,20.5\n"),
        ("named.csv", "z;x;y\n20;0;0\n20;3;0\n20.5;6;0\n"),
        ("tabs.tsv", "x [m]\ty [m]\tz [m]\n0\t0\t20\n3\t0\t20\n6\t0\t20.5\n"),
        ("comment.csv", "# from Blender\n\n0, 0, 20\n3, 0, 20\n6, 0, 20.5\n"),
        (
            "quoted.csv",
            '"x","y","z","name, place"\n"0",0,20,"a, b"\n3,0,"20"\n6,0,20.5',
        ),
        ("commas.csv", "x;y;z;\n0;0;20;\n3;0;20;\n6;0;20.5;\n"),
    ],
)
def test_csv(show, tmp_path, name, content):
    (tmp_path / name).write_text(content, encoding="utf-8")
    made = show(
        f"formations: {{dragon: {{type: csv, file: {name}}}}}\ntransitions: [dragon]\n"
    )
    assert made.drones == 3
    assert made.formations["dragon"].points.tolist() == [
        [0, 0, 20], [3, 0, 20], [6, 0, 20.5],
    ]  # fmt: skip


def test_accents_may_be_written_apart_from_their_letters(show, read):
    texts = ("\u00e9\u00f6", "e\u0301o\u0308")
    places = [
        show(
            f"drones: 40\nformations: {{a: {{type: text, text: {text}, height: 60, "
            "centre: [0, 0, 40]}}\ntransitions: [a]\n"
        )
        .formations["a"]
        .points
        for text in texts
    ]
    assert np.array_equal(*places)
    lone = 'drones: 4\nformations: {a: {type: text, text: "A\u200bB"}}\n'
    (error,) = (e for e in read(lone + "transitions: [a]\n").errors)
    assert error.message == "the font has no U+200B"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('x,y,z\n"3,5","10,2","25,7"\n', "line 2: x is written with a decimal comma"),
        ('"x";"y";"z"\n"3,5";"10,2";"25,7"\n', "line 2: x is written with a decimal"),
        ('x,y,z\n1,2,30\n"1,003.5",10,25\n', "line 3: x is text"),
        ("x,y,z\n3.5,10,25,99\n", "line 2: has 4 cells; the first line has 3"),
        ("1,2,30\n3,5,10,2\n", "line 2: has 4 cells; the first line has 3"),
    ],
)
def test_cells_of_csv_are_taken_whole_or_refused(read, tmp_path, content, words):
    (tmp_path / "a.csv").write_text(content, encoding="utf-8")
    result = read("formations: {a: {type: csv, file: a.csv}}\ntransitions: [a]\n")
    assert result.show is None
    assert any(words in item.message for item in result.errors), result.errors


def test_csv_with_colours(show, tmp_path):
    (tmp_path / "a.csv").write_text("x,y,z,r,g,b\n0,0,20,255,0,0\n3,0,20,0,128,255\n")
    made = show("formations: {a: {type: csv, file: a.csv}}\ntransitions: [a]\n")
    wanted = linear_light(np.array([[1, 0, 0], [0, 128 / 255, 1]]))
    assert np.allclose(made.formations["a"].colours, wanted)


OCTAHEDRON = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
FACES = [
    (0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5),
    (0, 3, 5),
]  # fmt: skip


def obj_file():
    lines = [f"v {x} {y} {z}" for x, y, z in OCTAHEDRON]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES]
    return "\n".join(lines).encode()


def stl_file():
    content = b"\x00" * 80 + struct.pack("<I", len(FACES))
    for face in FACES:
        content += struct.pack("<3f", 0, 0, 0)
        for corner in face:
            content += struct.pack("<3f", *OCTAHEDRON[corner])
        content += b"\x00\x00"
    return content


def glb_file():
    import trimesh

    return trimesh.Trimesh(OCTAHEDRON, FACES, process=False).export(file_type="glb")


@pytest.mark.parametrize(
    ("name", "make"), [("o.obj", obj_file), ("o.stl", stl_file), ("o.glb", glb_file)]
)
def test_mesh(show, tmp_path, name, make):
    (tmp_path / name).write_bytes(make())
    made = show(
        "drones: 80\nseparation: 0.1\nformations:\n"
        f"  gem: {{type: mesh, file: {name}, size: 20, centre: [0, 0, 40]}}\n"
        "transitions: [gem]\n"
    )
    places = made.formations["gem"].points - [0, 0, 40]
    assert np.allclose(np.abs(places).sum(axis=1), 10.0, atol=1e-6)  # on the surface
    area = 8 * math.sqrt(3) / 4 * (10 * math.sqrt(2)) ** 2 / 80
    assert gaps(places).min() > 0.7 * math.sqrt(area)
    octants = np.unique((places > 0) @ [1, 2, 4], return_counts=True)[1]
    assert octants.max() <= 2 * octants.min()


def test_a_model_stands_upright(show, tmp_path):
    mast = "v 0 0 0\nv 0.1 0 0\nv 0 10 0\nf 1 2 3\n"  # y is up in OBJ
    (tmp_path / "mast.obj").write_text(mast)
    made = show(
        "drones: 5\nseparation: 0.1\nformations: {mast: {type: mesh, file: mast.obj, "
        "size: 20}}\ntransitions: [mast]\n"
    )
    assert np.ptp(made.formations["mast"].points[:, 2]) > 15.0


def test_image(show, tmp_path):
    pixels = np.zeros((60, 90, 3), dtype=np.uint8)
    pixels[10:50, 10:40] = (255, 0, 0)
    pixels[10:50, 50:80] = (0, 255, 255)
    Image.fromarray(pixels).save(tmp_path / "flag.png")
    made = show(
        "drones: 40\nseparation: 0.1\nformations:\n"
        "  flag: {type: image, file: flag.png, height: 8, threshold: 0.1, "
        "centre: [0, 0, 20]}\ntransitions: [flag]\n"
    )
    flag = made.formations["flag"]
    left = flag.points[:, 0] < 0
    assert np.allclose(flag.colours[left], [1, 0, 0], atol=0.02)
    assert np.allclose(flag.colours[~left], [0, 1, 1], atol=0.02)
    assert 16 <= left.sum() <= 24
    assert np.abs(flag.points[:, 0]).min() > 0.8  # the dark gap between
    assert np.ptp(flag.points[:, 2]) == pytest.approx(8.0, abs=0.8)


def test_transforms_are_done_in_order(points):
    shape = "{type: points, points: [[1, 0, 0], [2, 0, 0]], transform: [%s]}"
    turned = points(shape % "{rotate: 90}, {shift: [5, 0, 9]}", 2)
    assert turned.tolist() == [[5, 1, 9], [5, 2, 9]]
    shifted = points(shape % "{shift: [5, 0, 9]}, {rotate: 90}", 2)
    assert shifted.tolist() == [[0, 6, 9], [0, 7, 9]]
    scaled = points(shape % "{scale: [3, 1, 1]}, {mirror: x}", 2)
    assert scaled.tolist() == [[-3, 0, 0], [-6, 0, 0]]
    tipped = points(shape % "{rotate: {angle: 90 deg, axis: y}}", 2)
    assert tipped.tolist() == [[0, 0, -1], [0, 0, -2]]


@given(st.floats(-360, 360), st.tuples(*[st.floats(-1, 1)] * 3).filter(any))
def test_rotation_keeps_distances(angle, axis):
    from showc.script.language.settings import Setting, Settings
    from showc.script.mark import Mark
    from showc.script.sections.placing import transform

    mark = Mark("", 1, 1, 1, 1)
    parts = [Setting(float(part), mark, mark) for part in axis]
    turn = Settings("rotate", mark, {
        "angle": Setting(math.radians(angle), mark, mark),
        "axis": Setting(parts, mark, mark),
    })  # fmt: skip
    change = Settings("transform", mark, {"rotate": Setting(turn, mark, mark)})
    places = np.random.default_rng(1).normal(size=(6, 3))
    moved, _ = transform(places, [change])
    before = np.linalg.norm(places[:, None] - places[None], axis=2)
    after = np.linalg.norm(moved[:, None] - moved[None], axis=2)
    assert np.allclose(before, after, atol=1e-12)
    assert np.linalg.det(np.linalg.lstsq(places, moved, rcond=None)[0]) > 0


def test_like_keeps_place_and_colour_and_changes_what_is_said(show):
    made = show(
        "drones: 6\nformations:\n"
        "  ring: {type: circle, radius: 6, centre: [10, 0, 20], colour: red}\n"
        "  wide: {like: ring, transform: [{scale: 2}]}\n"
        "  high: {like: ring, centre: [0, 0, 40], colour: blue}\n"
        "transitions: [ring, wide, high]\n"
    )
    ring, wide, high = (made.formations[name] for name in ("ring", "wide", "high"))
    middle = np.array([10, 0, 20])
    assert np.allclose(wide.points - middle, 2 * (ring.points - middle))
    assert np.allclose(high.points - [0, 0, 40], ring.points - middle)
    assert np.array_equal(wide.colours, ring.colours)
    assert np.allclose(high.colours, [0, 0, 1])


def test_parts_share_the_drones(show):
    made = show(
        "drones: 11\nformations:\n  face:\n    parts:\n"
        "      - {type: circle, radius: 9, colour: yellow}\n"
        "      - {type: points, points: [[-3, 3, 0], [3, 3, 0]], colour: blue}\n"
        "      - {type: line, length: 6, count: 3}\n"
        "    centre: [0, 0, 30]\ntransitions: [face]\n"
    )
    face = made.formations["face"]
    assert np.allclose(np.linalg.norm(face.points[:6] - [0, 0, 30], axis=1), 9)
    assert face.points[6].tolist() == [-3, 3, 30]
    assert np.ptp(face.points[8:, 0]) == 6
    assert np.allclose(face.colours[:6], [1, 1, 0])


def test_nothing_said_stands_above_the_launch_altitude(show):
    made = show(
        "drones: 8\nlaunch: {altitude: 14}\nformations:\n"
        "  ring: {type: circle, plane: front, radius: 6}\n"
        "  tipped: {type: circle, radius: 6, "
        "transform: [{rotate: {angle: 90, axis: x}}, {shift: [0, 0, 3]}]}\n"
        "transitions: [ring, tipped]\n"
    )
    assert made.formations["ring"].points[:, 2].min() == 14.0
    assert made.formations["tipped"].points[:, 2].min() == pytest.approx(17.0)


def test_spread_repairs_and_stays_flat(show):
    made = show(
        "drones: 30\nseparation: 2\nformations:\n"
        "  word: {type: text, text: HELLO, height: 6, spread: true}\n"
        "transitions: [word]\n"
    )
    word = made.formations["word"].points
    assert gaps(word).min() >= 2.0
    assert np.ptp(word[:, 1]) == 0.0


@settings(deadline=None, max_examples=30)
@given(
    st.integers(2, 40),
    st.integers(0, 10**6),
    st.sampled_from([1.0, 2.5]),
    st.booleans(),
)
def test_spreading_always_ends_apart(count, seed, stretch, coincide):
    rng = np.random.default_rng(seed)
    places = rng.normal(size=(count, 3))
    if coincide:
        places[: count // 2] = places[0]
    separation = Separation(1.0, "ellipsoid", stretch)
    moved = spread_apart(places, 1.0, separation)
    assert moved.shape == places.shape
    assert closest(moved, 1.0, separation) is None
    assert np.array_equal(moved, spread_apart(places, 1.0, separation))


def test_spreading_leaves_what_is_apart():
    places = np.array([[0.0, 0, 0], [3, 0, 0], [0, 3, 0]])
    moved = spread_apart(places, 2.0, Separation(2.0))
    assert np.allclose(moved, places, atol=1e-12)


@given(st.integers(1, 60), st.integers(0, 1000))
def test_even_points_are_different_candidates(count, seed):
    candidates = np.random.default_rng(seed).uniform(size=(60, 2))
    chosen = spread_evenly(candidates, count)
    assert len(set(chosen.tolist())) == count


def test_even_points_are_even():
    x, y = np.meshgrid(np.linspace(0, 1, 60), np.linspace(0, 1, 60))
    candidates = np.column_stack([x.ravel(), y.ravel()])
    gap = gaps(candidates[spread_evenly(candidates, 100)])
    assert gap.min() > 0.08  # a square grid of a hundred has 0.111
    assert gap.max() < 2.0 * gap.min()


def test_thinning_keeps_pieces_and_holes():
    raster = np.zeros((40, 60), dtype=bool)
    raster[5:35, 5:12] = True  # a bar
    yy, xx = np.mgrid[:40, :60]
    ring = np.hypot(yy - 20, xx - 40)
    raster |= (ring < 15) & (ring > 8)
    thin = thinned(raster)
    assert np.all(raster[thin])
    assert thin[:, :20].sum() < 32 and thin[:, :20].sum() > 20
    inside = np.hypot(yy - 20, xx - 40)[thin & (xx > 20)]
    assert np.all(np.abs(inside - 11.5) < 2.0)  # a closed line half way
    nodes, chains = traced(thin, 7.0)
    assert len(nodes) == 2  # the ends of the bar
    assert sorted(chain[0] == chain[-1] for chain in chains) == [False, True]


@pytest.mark.parametrize(
    ("formation", "code", "words"),
    [
        ("{type: svg, file: bad.svg}", "SHW110", "bad.svg"),
        ("{type: mesh, file: bad.obj}", "SHW110", "bad.obj"),
        ("{type: mesh, file: bad.stl}", "SHW110", "bad.stl"),
        ("{type: mesh, file: bad.glb}", "SHW110", "bad.glb"),
        ("{type: mesh, file: bad.blend}", "SHW110", "not a model that showc reads"),
        ("{type: mesh, file: cloud.obj}", "SHW110", "points or lines, but no faces"),
        ("{type: mesh, file: far.obj}", "SHW110", "no face whose corners are numbers"),
        ("{type: image, file: bad.png}", "SHW110", "not an image"),
        ("{type: text, text: A, font: bad.ttf}", "SHW110", "not a font"),
        ("{type: csv, file: bad.csv}", "SHW110", "line 1"),
        ("{type: text, text: '  '}", "SHW104", "no visible letters"),
        ("{type: image, file: dark.png}", "SHW110", "pixels that count as bright"),
        ("{type: svg, file: empty.svg}", "SHW110", "no curves"),
        ("{type: csv, file: empty.csv}", "SHW110", "no lines"),
        ("{type: csv, file: ../../../nowhere.csv}", "SHW109", "cannot be read"),
        ('{type: csv, file: "a\\0b.csv"}', "SHW109", "cannot be read"),
        ("{type: grid, rows: 2, columns: 2, count: 9}", "SHW205", "has 4 places"),
        ("{type: helix, radius: -2}", "SHW104", "radius"),
    ],
)
def test_faulty_inputs_are_named(read, tmp_path, formation, code, words):
    for ending in ("svg", "obj", "stl", "glb", "blend", "png", "ttf"):
        (tmp_path / f"bad.{ending}").write_bytes(b"\x89this is noise\x00\xff" * 9)
    (tmp_path / "bad.csv").write_text("1,2,three\n")
    (tmp_path / "cloud.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    far = "v 0 0 0\nv 1e200 0 0\nv 0 nan 0\nf 1 2 3\n"
    (tmp_path / "far.obj").write_text(far)
    (tmp_path / "empty.csv").write_text("\n\n")
    (tmp_path / "empty.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')
    Image.new("RGB", (20, 20)).save(tmp_path / "dark.png")
    result = read(f"drones: 9\nformations:\n  it: {formation}\ntransitions: [it]\n")
    assert result.show is None
    found = [item for item in result.errors if item.code == code]
    assert found and words in found[0].message
    assert found[0].span.line == 4
