"""The timeline leaves as what musicians' programs read, and comes back as cues."""

import pytest

from showc.pipeline.outlook import LegOutlook, cue_sheet
from showc.script.language.instants import music_time, read_cues

LEGS = [
    LegOutlook(0, "launch", True, "", 5.0, 6.0, 0.0),
    LegOutlook(1, "launch -> ring, slowly", True, "", 5.0, 8.0, 16.0, 24.0),
    LegOutlook(2, "hold", False, "", 4.0, 4.0, 24.0),
]


@pytest.mark.parametrize(("name", "csv"), [("a.txt", False), ("a.csv", True)])
def test_what_is_written_is_read_again(name, csv):
    sheet = cue_sheet(LEGS, 20.0, csv=csv)
    found = {key: music_time(one, None) for key, one in read_cues(sheet, name)}
    assert found == {"launch_ring_slowly": 0.0, "hold": 4.0}
