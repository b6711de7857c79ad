"""``showc simulate``: a compiled show flown in wind, many times."""

from __future__ import annotations

import json
from pathlib import Path

import click

from showc.cli.options import (
    Real,
    Whole,
    flag,
    given,
    json_option,
    log_argument,
    output_option,
    quiet_option,
)


@click.command(name="simulate")
@log_argument
@given(
    "--wind",
    type=Real(0.0, 30.0),
    metavar="M/S",
    default=0.0,
    help="Mean wind, from a random direction in each run.",
)
@given(
    "--gusts",
    type=click.Choice(("none", "light", "moderate", "severe")),
    default="none",
    help="Dryden turbulence: as in MIL-F-8785C for this wind (moderate), half of it "
    "(light), or one and a half times as much (severe).",
)
@given(
    "--runs",
    type=Whole(1, 10_000),
    metavar="N",
    default=10,
    help="Number of flights of the show.",
)
@click.option(
    "--seed",
    type=Whole(min=0),
    metavar="N",
    default=0,
    help="Seed of the gusts.",
)
@given(
    "--controller",
    type=click.Choice(("flatness", "predictive")),
    default="flatness",
    help="Differential flatness, or model predictive control over 0.8 s.",
)
@flag("--no-observer", text="Fly without the disturbance observer.")
@output_option(
    "RESULTS.json",
    "Where to put the results.  [default: OUTPUT-wind.json]",
)
@json_option
@quiet_option
def command(
    log: Path,
    wind: float,
    gusts: str,
    runs: int,
    seed: int,
    controller: str,
    no_observer: bool,
    output: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Simulate flights of a compiled show in wind.

    The model has twelve states, rotor lag, drag, delays and an imperfect estimator. The
    controller uses differential flatness or model prediction, with a disturbance
    observer. Gusts are Dryden turbulence with seeds. The result says how far drones
    stray from their paths, and how close they come. The model has typical parameters:
    it compares shows, winds and controllers, but does not describe a particular
    aircraft.

    The results go into the log, for showc report and showc view, and into a file beside
    it. A script can use the tracking error from this file (separation: tracking:
    measured).

    \b
      showc simulate output.mcap --wind 8 --gusts moderate --runs 50
    """
    from dataclasses import replace
    from math import degrees

    from showc.cli.console import progress
    from showc.errors import UsageError
    from showc.files import write_file
    from showc.log.additions import add, digest_of
    from showc.log.reader import read_log
    from showc.log.schema import WIND_NAME
    from showc.safety.assessment import show_of
    from showc.safety.fall import Fall
    from showc.simulate.campaign import Model, campaign
    from showc.simulate.results import Weather
    from showc.simulate.tracking import Gains

    if gusts != "none" and not wind:
        raise UsageError(
            f"--gusts {gusts} without a wind: turbulence grows with the wind, and is "
            "none in still air; give --wind too, for example --wind 8"
        )
    digest = digest_of(log)
    # Of the samples nothing is needed.
    logged = read_log(log, 1.0)
    show = show_of(logged)
    gains = replace(Gains(), observer=0.0) if no_observer else Gains()
    model = Model(gains, predictive=controller == "predictive")
    with progress(quiet=quiet or as_json) as watcher:
        found = campaign(
            logged, show, Weather(wind, gusts, runs, seed), watcher, model=model
        )
    results = found.to_json()
    content = {"log": log.name, "data_sha256": digest} | results
    written = (json.dumps(content, indent=1) + "\n").encode()
    add(log, WIND_NAME, written, digest)
    place = output or log.with_name(f"{log.stem}-wind.json")
    write_file(place, written)
    if as_json:
        click.echo(json.dumps(results, indent=1))
        return 0
    for tube in found.tubes:
        click.echo(
            f"{tube.name}: {tube.rms:.2f} m RMS, {100.0 * tube.share:.1f} % of flights "
            f"within {tube.radius:.2f} m (confidence 95 %)"
        )
    if show.drones > 1:
        asked = show.kept
        click.echo(
            f"nearest two drones: {found.whole.closest:.2f} m, {asked:.2f} m are asked "
            "for"
        )
    saturated = 100.0 * found.whole.saturated
    click.echo(
        f"rotors at their limits: {saturated:.2f} % of commands; limits of speed, body "
        f"rates and thrust, and a lean of {degrees(gains.lean):.0f}°: up to "
        f"{100.0 * found.whole.used:.0f} % used"
    )
    if wind:
        body, gravity = show.body, show.vehicle.gravity
        fall = Fall(show.vehicle.mass, body.drag_area, wind, gravity)
        click.echo(
            f"drag alone leans a drone that stands in this wind by up to "
            f"{degrees(fall.lean(wind)):.0f}°; the plan tilts to "
            f"{degrees(show.limits.tilt):.0f}° at most"
        )
    click.echo(f"added to {log}; wrote {place}")
    return 0
