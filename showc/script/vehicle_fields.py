"""The field table of the vehicle and its limits."""

from __future__ import annotations

from showc.script.kinds import Choice, Either, Field, Items, Quantity, Section
from showc.vehicle.presets import DEFAULT_PRESET, PRESETS

_OF_PRESET = "the preset's"
_OF_ENVELOPE = "the envelope's, else none but the airframe's own"
_ACCELERATION = Quantity("m/s²", minimum=0.1, maximum=100.0)
_INERTIA = Quantity("kg m²", minimum=1e-7, maximum=10.0)
_SPEED = Quantity("m/s", minimum=0.1, maximum=50.0)
_RATE = Quantity("deg/s", minimum=1.0, maximum=2000.0)
_TORQUE = Quantity("N m", minimum=1e-6, maximum=100.0)

_PART = Quantity("", minimum=0.0, maximum=1.0)

BATTERY = Section(
    "battery",
    "What the aircraft flies on, full at the start.",
    (
        Field(
            "capacity",
            Quantity("mAh", minimum=10.0, maximum=1e6),
            "Charge when full.",
            default_text=_OF_PRESET,
            examples=(2200, "2.2 Ah"),
        ),
        Field(
            "voltage",
            Quantity("V", minimum=1.0, maximum=100.0),
            "Open-circuit voltage when full: 4.2 V a cell.",
            default_text=_OF_PRESET,
        ),
        Field(
            "voltage_min",
            Quantity("V", minimum=0.5, maximum=100.0),
            "Least voltage under load.",
            default_text=_OF_PRESET,
        ),
        Field(
            "resistance",
            Quantity("ohm", minimum=0.0, maximum=10.0),
            "Resistance of battery, wiring and regulators.",
            default_text=_OF_PRESET,
        ),
        Field(
            "usable",
            _PART,
            "Part of the capacity that may be taken.",
            default_text=_OF_PRESET,
            examples=("80 %",),
        ),
        Field(
            "reserve",
            _PART,
            "Part of the capacity that must be left of the usable one.",
            default_text=_OF_PRESET,
            examples=("10 %",),
        ),
        Field(
            "hover_power",
            Quantity("W", minimum=0.1, maximum=1e5),
            "Electrical power of hovering, measured best.",
            default_text="the preset's, by the mass",
        ),
        Field(
            "idle_power",
            Quantity("W", minimum=0.0, maximum=1e4),
            "Part of the hover power that does not depend on thrust.",
            default_text=_OF_PRESET,
        ),
        Field(
            "rotor_radius",
            Quantity("m", minimum=0.005, maximum=2.0),
            "Radius of a rotor.",
            default_text=_OF_PRESET,
        ),
    ),
)

VEHICLE = Section(
    "vehicle",
    "What flies: a preset, or a preset with parameters of its own.",
    (
        Field(
            "preset",
            Choice(tuple(PRESETS)),
            "Known aircraft whose parameters hold where nothing else is said.",
            default=DEFAULT_PRESET,
        ),
        Field(
            "mass",
            Quantity("kg", minimum=0.01, maximum=25.0),
            "Take-off mass.",
            default_text=_OF_PRESET,
        ),
        Field(
            "arm_length",
            Quantity("m", minimum=0.01, maximum=2.0),
            "Distance from the centre of mass to a motor.",
            default_text=_OF_PRESET,
        ),
        Field(
            "thrust_coefficient",
            Quantity("N s²/rad²", minimum=1e-10, maximum=1e-2),
            "Thrust of a rotor over its squared speed.",
            default_text=_OF_PRESET,
        ),
        Field(
            "torque_coefficient",
            Quantity("N m s²/rad²", minimum=1e-12, maximum=1e-3),
            "Drag torque of a rotor over its squared speed.",
            default_text=_OF_PRESET,
        ),
        Field(
            "inertia",
            Items(_INERTIA, 3, 3),
            "Moments of inertia about the body's x, y and z axes.",
            default_text=_OF_PRESET,
        ),
        Field(
            "rotor_speed_max",
            Quantity("rad/s", minimum=10.0, maximum=20_000.0),
            "Greatest speed of a rotor.",
            default_text=_OF_PRESET,
        ),
        Field(
            "torque_arm",
            Choice(("included", "multiplied")),
            "`included`: the torques U2 and U3 contain the arm, as the rotor "
            "allocation gives them. `multiplied`: the equations of motion multiply "
            "them by the arm once more, as one printed form does.",
            default_text=_OF_PRESET,
        ),
        Field(
            "size",
            Quantity("m", minimum=0.01, maximum=10.0),
            "Greatest size of the aircraft, from propeller tip to propeller tip.",
            default_text=_OF_PRESET,
        ),
        Field(
            "drag_area",
            Items(Quantity("m²", minimum=1e-5, maximum=10.0), 2, 2),
            "Least and greatest drag area of the falling aircraft: drag coefficient "
            "times area.",
            default_text=_OF_PRESET,
            examples=([0.02, 0.04],),
        ),
        Field("battery", BATTERY, BATTERY.description, default={}),
        Field(
            "envelope",
            Choice(("autopilot", "airframe")),
            "What the flight is solved for. `autopilot`: the airframe, and the speeds "
            "and accelerations that the preset's autopilot was seen to follow. "
            "`airframe`: the airframe alone.",
            default="autopilot",
        ),
    ),
    short="preset",
)

LIMITS = Section(
    "limits",
    "What each drone keeps at every instant.",
    (
        Field(
            "speed",
            Either((_SPEED, Items(_SPEED, 3, 3))),
            "Greatest speed along each axis: one number, or one each for x, y, z.",
            default_text=_OF_PRESET,
            examples=(5, "18 km/h", [5, 5, 2]),
        ),
        Field(
            "climb",
            _SPEED,
            "Greatest climb speed.",
            default_text="`speed` along z, else the preset's",
        ),
        Field(
            "descent",
            _SPEED,
            "Greatest descent speed.",
            default_text="`speed` along z, else the preset's",
        ),
        Field(
            "level_speed",
            _SPEED,
            "Greatest level speed in any direction, sqrt(vx² + vy²).",
            default_text=_OF_ENVELOPE,
        ),
        Field(
            "acceleration",
            _ACCELERATION,
            "Greatest level acceleration in any direction, sqrt(ax² + ay²).",
            default_text=_OF_ENVELOPE,
        ),
        Field(
            "acceleration_up",
            _ACCELERATION,
            "Greatest upward acceleration.",
            default_text=_OF_ENVELOPE,
        ),
        Field(
            "acceleration_down",
            _ACCELERATION,
            "Greatest downward acceleration.",
            default_text=_OF_ENVELOPE,
        ),
        Field(
            "jerk",
            Quantity("m/s³", minimum=1.0, maximum=1000.0),
            "Greatest rate of the acceleration. Thrust is then continuous.",
            default_text="none",
            examples=("15 m/s^3",),
        ),
        Field(
            "tilt",
            Quantity("deg", minimum=1.0, maximum=80.0),
            "Greatest roll and pitch.",
            default_text=_OF_PRESET,
            examples=("20 deg", "0.35 rad"),
        ),
        Field(
            "body_rate",
            Either((_RATE, Items(_RATE, 3, 3))),
            "Greatest body rates p, q, r: one number or three.",
            default_text=_OF_PRESET,
            examples=("1.7 rad/s", 90),
        ),
        Field(
            "thrust_min",
            Quantity("N", minimum=0.0, maximum=1000.0),
            "Least total thrust.",
            default_text=_OF_PRESET,
        ),
        Field(
            "thrust_max",
            Quantity("N", minimum=0.01, maximum=1000.0),
            "Greatest total thrust.",
            default_text="what the rotors can give",
        ),
        Field(
            "torque",
            Items(_TORQUE, 3, 3),
            "Greatest torques U2, U3, U4.",
            default_text="what the rotors can give",
        ),
    ),
)
