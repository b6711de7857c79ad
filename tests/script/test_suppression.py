"""Passing over a warning takes a code and a reason, and never hides an error."""

TAIL = "formations: {ring: {type: circle, radius: 8, count: 4}}\ntransitions: [ring]\n"


def codes(result):
    return [item.code for item in result.diagnostics]


def test_on_the_line(read):
    result = read(f"separation: 1 # showc: ignore[SHW303] we have RTK\n{TAIL}")
    assert codes(result) == []
    (passed,) = result.suppressed
    assert passed.diagnostic.code == "SHW303"
    assert passed.reason == "we have RTK"


def test_on_the_line_before(read):
    result = read(f"# showc: ignore[SHW303, SHW118] we have RTK\nseparation: 1\n{TAIL}")
    assert codes(result) == ["SHW117"]
    assert len(result.suppressed) == 1


def test_not_from_elsewhere(read):
    result = read(f"separation: 1\n\n# showc: ignore[SHW303] we have RTK\n{TAIL}")
    assert codes(result) == ["SHW303", "SHW117"]
    assert result.suppressed == ()


def test_an_error_stays(read):
    result = read(
        "formations: {ring: {type: circle, radius: 1, count: 9}}"
        " # showc: ignore[SHW201] it will be fine\ntransitions: [ring]\n"
    )
    assert codes(result) == ["SHW201", "SHW117"]
    assert result.show is None
    assert "cannot be passed over" in result.diagnostics[1].message


def test_strict_counts_warnings(read):
    result = read(f"separation: 1\n{TAIL}")
    assert result.show is not None
    assert result.exit_code() == 0
    assert result.exit_code(strict=True) == 1
