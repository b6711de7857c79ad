"""All vehicles of a streamed show on one clock, to its end or to an orderly stop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from showc.autopilot.feedforward import AHEAD, Feedforward
from showc.autopilot.parameters import GAINS as MISSION_GAINS
from showc.autopilot.parameters import Gains
from showc.progress import Silent
from showc.safety.stop import Authority
from showc.vehicle.presets import ARDUCOPTER
from showc.vehicle_link.clock import History, Rounds, ShowClock
from showc.vehicle_link.network import AUTOPILOT_COMPONENT, LISTENING, Address
from showc.vehicle_link.pilot import Phase, Pilot
from showc.vehicle_link.setpoints import authority_of
from showc.vehicle_link.tuning import ParameterWishes

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.progress import Progress
    from showc.vehicle_link.flown import FlownLog
    from showc.vehicle_link.network import Network
    from showc.vehicle_link.setpoints import Instant, StreamPlan
    from showc.vehicle_link.stream import Stop, StreamOptions


COUNTDOWN = 1.0
"""Time between the readiness of all vehicles and the start of the clock [s]."""

SETTLING = 2.0
"""Time for which a stopped fleet is held by setpoints, before it lands or is handed to
its autopilots [s]."""

LANDING_TIME = 60.0
"""Time in which vehicles must have landed, besides that of the descent [s]."""

DESCENT_SPEED = 0.5
"""Slowest mean speed of a landing [m/s]: ArduCopter's last ten metres by default."""

GAINS = {
    name: value
    for name, value in ARDUCOPTER.parameters
    if not name.startswith("WPNAV_")
}
"""Gains with which ArduCopter was measured to follow; its limits depend on the show."""

STANDSTILL = 1.0
"""Time without setpoints after which the fleet is not where its clock has it [s]: it
has flown on straight. Such a gap ends the show, each vehicle braking where it is."""

HOLDING_TIME = 10.0
"""Time in which they must have taken over the hold, or their parameters back [s]."""


class Conductor:
    """Keeps all vehicles on one clock.

    Parameters
    ----------
    plan
        What they fly.
    network
        How they are reached; brings the wall's clock.
    options
        Rate, corridor, patience.
    progress
        Notified of every second of the show.
    stop
        Asked for the wish to stop.
    """

    def __init__(
        self,
        plan: StreamPlan,
        network: Network,
        options: StreamOptions,
        progress: Progress,
        stop: Stop,
    ) -> None:
        self.plan, self.network, self.options = plan, network, options
        self.progress, self.stop_wish = progress, stop
        self.clock = network.clock
        pads, joins = plan.pads(), plan.at(plan.launch_end).position
        wishes = ParameterWishes(
            plan.arducopter_needs(),
            options.set_parameters,
            GAINS if options.set_gains else {},
        )
        self.pilots = [
            Pilot(
                drone,
                Address(options.system(drone), AUTOPILOT_COMPONENT),
                plan.frame,
                start=joins[index],
                pad=pads[index],
                reach=min(options.corridor, _half_way(pads, index)),
                wishes=wishes,
            )
            for index, drone in enumerate(plan.drones)
        ]
        self.deviation = np.zeros(len(self.pilots))
        self.rounds = Rounds()
        self.show: ShowClock | None = None
        self.join = 0.0
        self._by_system = {
            pilot.vehicle.system: index for index, pilot in enumerate(self.pilots)
        }
        self._history = History()
        self._record: FlownLog | None = None
        self._shift: Feedforward | None = None
        self._stood_still = ""
        self._told = np.full(len(self.pilots), -np.inf)
        self._ticked = self._advanced = 0.0

    @property
    def shown(self) -> float:
        """Show time reached [s]."""
        return 0.0 if self.show is None else min(self.show.time, self.plan.duration)

    def run(self, record: FlownLog | None) -> str:
        """Fly the show; return why it was stopped, nothing if it was not.

        Whatever goes wrong, in a vehicle or in this program, ends in an orderly stop.
        """
        self._record = record
        try:
            reason = self._prepare() or self._fly() or self._land()
        except KeyboardInterrupt:
            reason = "stopped by the operator"
        except Exception as error:  # noqa: BLE001 - vehicles are in the air
            reason = f"this program failed: {type(error).__name__}: {error}"
        if reason:
            try:
                self._stop()
            except Exception as error:  # noqa: BLE001 - as above
                reason += f"; stopping failed: {type(error).__name__}: {error}"
                self._handed_over([pilot for pilot in self.pilots if pilot.tells.armed])
        self._restore()
        return reason

    # --- on the ground --------------------------------------------------------------

    def _prepare(self) -> str:
        """Bring all vehicles to READY; return why that failed."""
        self.progress.stage("vehicles ready", len(self.pilots))
        deadline = self.clock.now() + self.options.ready_timeout
        ready, arm = 0, False
        while ready < len(self.pilots):
            now = self._listen(0.05)
            arm = arm or self._may_arm(now)
            for pilot in self.pilots:
                self._send(pilot, pilot.prepare(now, arm=arm))
            reason = self.stop_wish.reason or self._unfit(arm=arm)
            if reason:
                return reason
            if now > deadline:
                return self._late()
            count = sum(pilot.phase is Phase.READY for pilot in self.pilots)
            self.progress.advance(count - ready)
            ready = count
        return ""

    def _may_arm(self, now: float) -> bool:
        """Whether all vehicles wait to be armed, and were listened to long enough."""
        may = all(
            pilot.phase is Phase.WAITING
            and pilot.tells.first_heard is not None
            and now - pilot.tells.first_heard > LISTENING
            for pilot in self.pilots
        )
        if may:
            # From here on nothing but the vehicles' own addresses is heard.
            self.network.seal()
        return may

    def _unfit(self, *, arm: bool) -> str:
        """Say which vehicle cannot begin the show."""
        for pilot in self.pilots:
            claim = self.network.claim(pilot.vehicle.system)
            if claim and not arm:
                pilot.fail(claim)
            unfit = pilot.unfit()
            if unfit:
                pilot.fail(unfit)
            if pilot.phase is Phase.FAILED:
                return f"drone {pilot.drone + 1} {pilot.reason}"
        return ""

    def _late(self) -> str:
        """Say which vehicle is not ready in time."""
        late = next(p for p in self.pilots if p.phase is not Phase.READY)
        for pilot in self.pilots:
            if pilot.phase not in {Phase.READY, Phase.WAITING}:
                late = pilot
                break
        state = late.phase.value
        if late.phase is Phase.UNHEARD and late.vehicle.system in (
            self.network.untrusted
        ):
            state = "sends no right signature for this key"
        words = f" ({late.tells.text!r})" if late.tells.text else ""
        return (
            f"drone {late.drone + 1} is not ready after "
            f"{self.options.ready_timeout:g} s: {state}{words}"
        )

    # --- in the show ----------------------------------------------------------------

    def _fly(self) -> str:
        """Send setpoints on the common clock to the end; return why it stopped."""
        ardupilot = any(pilot.tells.ardupilot for pilot in self.pilots)
        self.join = self.plan.launch_end if ardupilot else 0.0
        if self.options.set_gains and ardupilot:
            gains = Gains.of(MISSION_GAINS | GAINS)
            self._shift = Feedforward(gains, len(self.pilots))
        show = self.show = ShowClock(self.plan, self._authority(), self.join)
        length = max(1, round(self.plan.duration - self.join))
        self.progress.stage("show", length)
        for pilot in self.pilots:
            pilot.phase = Phase.FLYING
        self._ticked = self._advanced = self.clock.now()
        begin = self._ticked + COUNTDOWN - self.options.lead
        told = 0
        while show.time < self.plan.duration:
            now = self._tick(begin)
            reason = self.stop_wish.reason or self._stood_still or self._watch(now)
            if reason:
                return reason
            seconds = int(min(show.time, self.plan.duration) - self.join)
            self.progress.advance(seconds - told)
            told = seconds
        self.progress.advance(max(0, length - told))
        return ""

    def _authority(self) -> Authority:
        """Return the accelerations that every vehicle follows, or the plan asks for."""
        found = [
            authority_of(pilot.tuning.flown_with)
            for pilot in self.pilots
            if pilot.tuning.parameters
        ]
        plan = self.plan.authority
        if len(found) < len(self.pilots):
            return plan
        return Authority(
            max(plan.level, min(one.level for one in found)),
            max(plan.up, min(one.up for one in found)),
            max(plan.down, min(one.down for one in found)),
        )

    def _tick(self, begin: float | None = None) -> float:
        """Wait for the next setpoints and send them; return the time.

        A late tick is not made up for: its setpoints are for now.
        """
        assert self.show is not None  # noqa: S101 - ticks are the show's
        period = 1.0 / self.options.rate
        due = self._ticked + period
        while self.clock.now() < due:
            self._listen(due - self.clock.now())
        now = self._listen(0.0)
        span = now - self._advanced
        if span > STANDSTILL and self.show.rate:
            self._stood_still = f"this program stood still for {span:.1f} s"
            return now
        if begin is not None and self._advanced < begin <= now:
            self.show.run()
            span = now - begin
        self._advanced = now
        # A clock that changes its rate does so in small steps, however late it is.
        steps = max(1, int(np.ceil(span / period - 1e-6)))
        for _ in range(steps):
            self.show.advance(span / steps)
        late = now - due
        self._ticked = now if late > period else due
        self._setpoints(now, due, span)
        return now

    def _setpoints(self, now: float, due: float, span: float) -> None:
        """Send every vehicle where it is to be."""
        assert self.show is not None  # noqa: S101 - as above
        show = self.show
        if show.time > self.plan.duration:
            show.hold_at(self.plan.duration)
        plain = show.instant()
        shifted = self._shifted(plain, span)
        stamp = round(show.time * 1000.0)
        for index, pilot in enumerate(self.pilots):
            instant = shifted if pilot.tells.ardupilot else plain
            message = pilot.setpoint(
                instant.position[index],
                instant.velocity[index],
                instant.acceleration[index],
                stamp,
            )
            self.network.send(message, pilot.vehicle.system)
        self._history.note(now + self.options.lead, show.time)
        self.rounds.note(due, self.clock.now())

    def _shifted(self, instant: Instant, span: float) -> Instant:
        """Return what brings vehicles there, ``span`` [s] after the last ones."""
        assert self.show is not None  # noqa: S101 - as above
        shift = self._shift
        if shift is None:
            return instant
        soon = self.show.instant(AHEAD)
        shift.advance(
            span,
            (instant.velocity, instant.acceleration),
            (soon.velocity, soon.acceleration),
        )
        return instant.beyond(shift)

    def _watch(self, now: float) -> str:
        """Return what is wrong with a vehicle in flight."""
        for index, pilot in enumerate(self.pilots):
            trouble = pilot.trouble(now, self.options.link_timeout)
            if not trouble and self.deviation[index] > self.options.corridor:
                trouble = f"is {self.deviation[index]:.1f} m from its trajectory"
            if trouble:
                pilot.fail(trouble)
                return f"drone {pilot.drone + 1} {pilot.reason}"
        return ""

    # --- down and out ---------------------------------------------------------------

    def _land(self) -> str:
        """Land all vehicles; return why that failed."""
        self.progress.stage("landing", len(self.pilots))
        return self._brought_down(self.pilots)

    def _brought_down(self, pilots: list[Pilot]) -> str:
        """Land these vehicles and wait until they are disarmed."""
        flying = list(pilots)
        heights = [
            float(place.position[2] - pilot.pad[2])
            for pilot in pilots
            if (place := pilot.tells.place) is not None
        ]
        descent = max(heights, default=0.0) / DESCENT_SPEED
        deadline = self.clock.now() + LANDING_TIME + descent
        while flying:
            now = self._listen(0.05)
            if now > deadline:
                return f"drone {flying[0].drone + 1} has not landed"
            for pilot in flying:
                if pilot.tells.armed:
                    self._send(pilot, pilot.land(now))
                else:
                    pilot.landed()
                    self.progress.advance()
            flying = [pilot for pilot in flying if pilot.phase is not Phase.LANDED]
        return ""

    def _stop(self) -> None:
        """Stop in order: the fleet's clock to rest, then as the options say.

        On the ground and in the climb all vehicles land. A vehicle that has left the
        mode of setpoints by itself is in other hands: it is left alone.
        """
        reasons = {pilot.drone: pilot.reason for pilot in self.pilots}
        # What watches may be what failed.
        self.progress = Silent()
        try:
            if self.show is None:
                self._brought_down(self._ours())
            elif self._ours():
                self._rest()
                self._after_rest()
        finally:
            for pilot in self.pilots:
                if reasons[pilot.drone]:
                    pilot.phase, pilot.reason = Phase.FAILED, reasons[pilot.drone]

    def _rest(self) -> None:
        """Bring the common clock to rest, and hold there for a moment."""
        assert self.show is not None  # noqa: S101 - the show has begun
        self.show.stop()
        while not (self.show.resting or self._stood_still):
            self._tick()
        until = self.clock.now() + SETTLING
        while self.clock.now() < until and not self._stood_still:
            self._tick()

    def _after_rest(self) -> None:
        """Hold, land or return."""
        assert self.show is not None  # noqa: S101 - the show has begun
        wish = self.options.after_stop
        ours = self._ours()
        if wish == "land" and not self._may_land():
            wish = "return"
        if self._stood_still:
            wish = "hold"
        if wish == "return" and self.show.time < self.plan.landing_start:
            wish = "land" if self._returned() else "hold"
        if wish == "hold":
            self._handed_over(ours)
        else:
            self._brought_down(ours)

    def _ours(self) -> list[Pilot]:
        """Return the vehicles in the air that are in no other hands."""
        return [pilot for pilot in self.pilots if not pilot.off_mode()]

    def _may_land(self) -> bool:
        """Whether no drone stands above another: only then may all go straight down."""
        assert self.show is not None  # noqa: S101 - the show has begun
        flat = self.show.instant().position[:, :2]
        gaps = np.linalg.norm(flat[:, None] - flat[None, :], axis=2)
        np.fill_diagonal(gaps, np.inf)
        return bool(gaps.min(initial=np.inf) >= self.plan.separation)

    def _returned(self) -> bool:
        """Fly the plan backwards to where it was joined; False: stopped again."""
        assert self.show is not None  # noqa: S101 - the show has begun
        show, wishes = self.show, self.stop_wish.count
        show.turn_back(self.plan.return_rate)
        while show.time > self.plan.launch_end:
            self._tick()
            if self._stood_still:
                return False
            if self.stop_wish.count > wishes:
                self._rest()
                return False
        show.hold_at(self.plan.launch_end)
        self._rest()
        return True

    def _handed_over(self, pilots: list[Pilot]) -> None:
        """Let these vehicles hover by themselves."""
        deadline = self.clock.now() + HOLDING_TIME
        while self.clock.now() < deadline:
            now = self._listen(0.05)
            open_ = [pilot for pilot in pilots if not pilot.held and pilot.tells.armed]
            if not open_:
                return
            for pilot in open_:
                self._send(pilot, pilot.hold(now))

    def _restore(self) -> None:
        """Give landed vehicles their parameters back."""
        deadline = self.clock.now() + HOLDING_TIME
        while self.clock.now() < deadline:
            if all(pilot.restored for pilot in self.pilots):
                return
            now = self._listen(0.05)
            for pilot in self.pilots:
                self._send(pilot, pilot.restore(now))

    # --- the link -------------------------------------------------------------------

    def _listen(self, span: float) -> float:
        """Take messages for up to ``span`` [s]; return the time."""
        for received in self.network.poll(max(span, 0.0)):
            if received.sender.component != AUTOPILOT_COMPONENT:
                continue
            index = self._by_system[received.sender.system]
            self.pilots[index].handle(received.message, self.clock.now())
            if received.message.get_type() == "LOCAL_POSITION_NED":
                self._note(index)
        return self.clock.now()

    def _note(self, index: int) -> None:
        """Log where a flying vehicle is, and how far that is from its plan."""
        pilot = self.pilots[index]
        place = pilot.tells.place
        if pilot.phase is not Phase.FLYING or place is None:
            return
        moment = self._history.show_time(place.moment)
        if moment is None:
            return
        planned = self.plan.position[index](moment)
        off = float(np.linalg.norm(place.position - planned))
        self.deviation[index] = max(self.deviation[index], off)
        if self._record is None or moment <= max(self._told[index], self.join):
            return
        self._told[index] = moment
        try:
            self._record.add(pilot.drone, moment, place.position, place.velocity)
        except Exception as error:  # noqa: BLE001 - a full disk stops no show
            self._record.fault, self._record = str(error), None
            self.progress.note(f"the flight is no longer recorded: {error}")

    def _send(self, pilot: Pilot, messages: list[Any]) -> None:
        for message in messages:
            self.network.send(message, pilot.vehicle.system)


def _half_way(pads: FloatArray, index: int) -> float:
    """Half the distance of a pad to the nearest other one [m]."""
    gaps = np.linalg.norm((pads - pads[index])[:, :2], axis=1)
    gaps[index] = np.inf
    return 0.5 * float(gaps.min())
