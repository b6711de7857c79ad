"""What is known of flights is the same where missions are planned and proved."""

import tomllib
from dataclasses import asdict
from pathlib import Path

import showc.verify.missions.law
from showc.autopilot.timing import TUBES


def test_the_proof_allows_for_the_flights_that_the_plan_allows_for():
    table = Path(showc.verify.missions.law.__file__).with_suffix(".toml")
    proved = tomllib.loads(table.read_text(encoding="utf-8"))["tubes"]
    planned = [asdict(row) for row in TUBES]
    assert [(row["wind"], row["off"], row["late"]) for row in proved] == [
        (
            row["wind"],
            [list(band) for band in row["bands"]],
            [row["late"], row["late_fast"]],
        )
        for row in planned
    ]
