def test_a_preference_that_is_none_ends_in_one_message(read):
    text = "prefer: calm\nformations: {a: {type: circle, count: 4, radius: 6}}\n"
    (found,) = read(text + "transitions: [a]\n").errors
    assert found.code == "SHW103" and "`calm`" in found.message
