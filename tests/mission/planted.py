"""A compiled show on disk, and lies planted in it with all hashes made to fit."""

from __future__ import annotations

import hashlib
import json
from collections import Counter

from synthetic import decoded

from showc.log.container import open_log
from showc.log.facts import fleet_token
from showc.log.writer import write_log
from showc.mission import mission_files
from showc.pipeline.compile import build_manifest
from showc.verify.missions.folder import Folder, Missions
from showc.verify.samples import Samples, join
from showc.verify.specification.demands import hold_against


class OtherManifest:
    """A log with another manifest attached."""

    def __init__(self, log, manifest):
        self.log, self.manifest = log, manifest

    def __getattr__(self, name):
        return getattr(self.log, name)

    def attachment(self, name):
        return self.manifest if name == "manifest.json" else self.log.attachment(name)


class Case:
    """Missions on disk beside their log, and what is needed to check them."""

    def __init__(self, folder, flight, start=None, **options):
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / "output.mcap"
        self.folder = folder / "output"
        self.missions = mission_files(flight, start=start, **options)
        self.described = {
            "autopilot": options.get("autopilot", "ardupilot"),
            "start": None if start is None else start.isoformat(),
            "prediction": self.missions.prediction,
        }
        self.files = dict(self.missions.files)
        self.manifest = build_manifest(
            flight,
            token=self.missions.fleet_token,
            missions=self.described,
            files=self.files,
        )
        with self.path.open("wb") as stream:
            write_log(
                flight,
                stream,
                manifest=self.manifest,
                predicted=self.missions.predicted,
            )
        self.log = open_log(self.path)
        self.show = decoded(self.log)
        self.script = flight.itinerary.show
        # What lies in the folder, by name.
        self.written = {}
        self._write(self.files, self.manifest)

    def _write(self, files, manifest):
        for name, content in {**files, "manifest.json": manifest}.items():
            # Most of a folder is as it was after a lie, and stays.
            if self.written.get(name) != content:
                path = self.folder / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
                self.written[name] = content

    def checks(self, script=None):
        """All checks of the missions, by code."""
        found = self._found(script or self.script, drawn=True)
        assert max(Counter(check.code for check in found).values()) == 1
        return {check.code: check for check in found}

    def failures(self, *, drawn=True):
        """Codes of the checks that fail; those of what the log draws if ``drawn``."""
        found = self._found(self.script, drawn=drawn)
        return {check.code for check in found if check.verdict == "fail"}

    def _found(self, script, *, drawn):
        asked = hold_against(self.script, self.show)
        missions = Missions(Folder(self.log, script), self.log, self.show, asked)
        found = [check for part in missions.parts() for check in part()]
        if drawn and missions.tubes is not None:
            samples = Samples(self.log, self.show, asked.lights, script, missions.tubes)
            seen = join(part() for part in samples.parts())
            found += [check for check in seen if check.code == "VRF421"]
        return found

    def caught(self, changed=(), manifest=lambda content: content, *, drawn=False):
        """Codes that fail with files changed, names to contents; puts all back."""
        files = {**self.files, **dict(changed)}
        token = fleet_token(files)
        for name, content in files.items():
            if name.endswith(".plan") and name not in dict(changed):
                files[name] = content.replace(
                    self.missions.fleet_token.encode(), token.encode()
                )
        wanted = json.loads(self.manifest)
        wanted["fleet"] = token
        wanted["missions"]["files"] = {
            name: hashlib.sha256(content).hexdigest() for name, content in files.items()
        }
        content = json.dumps(manifest(wanted)).encode()
        whole = self.log
        self._write(files, content)
        self.log = OtherManifest(whole, content)
        try:
            return self.failures(drawn=drawn)
        finally:
            self.log = whole
            for name in set(files) - set(self.files):
                (self.folder / name).unlink()
                del self.written[name]
            self._write(self.files, self.manifest)

    def with_row(self, drone, change):
        """Mission of a drone with its rows (lists of fields) passed through."""
        name = f"missions/drone_{drone:04d}.waypoints"
        head, *rows = self.files[name].decode().splitlines()
        changed = change([row.split("\t") for row in rows])
        for number, row in enumerate(changed):
            row[0] = str(number)
        lines = [head, *("\t".join(row) for row in changed)]
        return {name: ("\n".join(lines) + "\n").encode()}

    def alike(self, drone, change):
        """Mission and plan of a drone with rows changed, put in or taken out alike."""
        changed = self.with_row(drone, change)
        (text,) = changed.values()
        plan = f"missions/drone_{drone:04d}.plan"
        document = json.loads(self.files[plan])
        rows = [line.split("\t") for line in text.decode().splitlines()[1:]]
        # PX4's missions have no row for a home.
        homes = len(self.files[plan.replace("plan", "waypoints")].splitlines()) - 1
        homes -= len(document["mission"]["items"])
        document["mission"]["items"] = [
            entry(number, row) for number, row in enumerate(rows[homes:], 1)
        ]
        document["fleetToken"] = fleet_token({**self.files, **changed})
        return {**changed, plan: json.dumps(document).encode()}


def entry(number, row):
    """A row as a plan has it."""
    found = {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": int(row[3]),
        "doJumpId": number,
        "frame": int(row[2]),
        "params": [float(field) for field in row[4:11]],
    }
    if found["frame"] == 3:
        height = float(row[10])
        found |= {"AMSLAltAboveTerrain": None, "Altitude": height, "AltitudeMode": 1}
    return found
