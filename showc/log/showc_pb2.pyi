from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Vector3(_message.Message):
    __slots__ = ("x", "y", "z")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    z: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ...) -> None: ...

class Rules(_message.Message):
    __slots__ = ("format_version", "name", "drones", "duration", "site", "vehicle", "separation", "yaw_held", "heading", "log_rate", "formations", "limits")
    FORMAT_VERSION_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    DRONES_FIELD_NUMBER: _ClassVar[int]
    DURATION_FIELD_NUMBER: _ClassVar[int]
    SITE_FIELD_NUMBER: _ClassVar[int]
    VEHICLE_FIELD_NUMBER: _ClassVar[int]
    SEPARATION_FIELD_NUMBER: _ClassVar[int]
    YAW_HELD_FIELD_NUMBER: _ClassVar[int]
    HEADING_FIELD_NUMBER: _ClassVar[int]
    LOG_RATE_FIELD_NUMBER: _ClassVar[int]
    FORMATIONS_FIELD_NUMBER: _ClassVar[int]
    LIMITS_FIELD_NUMBER: _ClassVar[int]
    format_version: int
    name: str
    drones: int
    duration: float
    site: Site
    vehicle: Vehicle
    separation: Separation
    yaw_held: bool
    heading: float
    log_rate: float
    formations: _containers.RepeatedCompositeFieldContainer[Formation]
    limits: _containers.RepeatedCompositeFieldContainer[Limits]
    def __init__(self, format_version: _Optional[int] = ..., name: _Optional[str] = ..., drones: _Optional[int] = ..., duration: _Optional[float] = ..., site: _Optional[_Union[Site, _Mapping]] = ..., vehicle: _Optional[_Union[Vehicle, _Mapping]] = ..., separation: _Optional[_Union[Separation, _Mapping]] = ..., yaw_held: _Optional[bool] = ..., heading: _Optional[float] = ..., log_rate: _Optional[float] = ..., formations: _Optional[_Iterable[_Union[Formation, _Mapping]]] = ..., limits: _Optional[_Iterable[_Union[Limits, _Mapping]]] = ...) -> None: ...

class Site(_message.Message):
    __slots__ = ("latitude", "longitude", "altitude", "heading", "volume_min", "volume_max", "fence", "fence_margin")
    LATITUDE_FIELD_NUMBER: _ClassVar[int]
    LONGITUDE_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_FIELD_NUMBER: _ClassVar[int]
    HEADING_FIELD_NUMBER: _ClassVar[int]
    VOLUME_MIN_FIELD_NUMBER: _ClassVar[int]
    VOLUME_MAX_FIELD_NUMBER: _ClassVar[int]
    FENCE_FIELD_NUMBER: _ClassVar[int]
    FENCE_MARGIN_FIELD_NUMBER: _ClassVar[int]
    latitude: float
    longitude: float
    altitude: float
    heading: float
    volume_min: Vector3
    volume_max: Vector3
    fence: _containers.RepeatedScalarFieldContainer[float]
    fence_margin: float
    def __init__(self, latitude: _Optional[float] = ..., longitude: _Optional[float] = ..., altitude: _Optional[float] = ..., heading: _Optional[float] = ..., volume_min: _Optional[_Union[Vector3, _Mapping]] = ..., volume_max: _Optional[_Union[Vector3, _Mapping]] = ..., fence: _Optional[_Iterable[float]] = ..., fence_margin: _Optional[float] = ...) -> None: ...

class Vehicle(_message.Message):
    __slots__ = ("name", "mass", "arm_length", "thrust_coefficient", "torque_coefficient", "inertia", "rotor_speed_max", "gravity", "torque_factor")
    NAME_FIELD_NUMBER: _ClassVar[int]
    MASS_FIELD_NUMBER: _ClassVar[int]
    ARM_LENGTH_FIELD_NUMBER: _ClassVar[int]
    THRUST_COEFFICIENT_FIELD_NUMBER: _ClassVar[int]
    TORQUE_COEFFICIENT_FIELD_NUMBER: _ClassVar[int]
    INERTIA_FIELD_NUMBER: _ClassVar[int]
    ROTOR_SPEED_MAX_FIELD_NUMBER: _ClassVar[int]
    GRAVITY_FIELD_NUMBER: _ClassVar[int]
    TORQUE_FACTOR_FIELD_NUMBER: _ClassVar[int]
    name: str
    mass: float
    arm_length: float
    thrust_coefficient: float
    torque_coefficient: float
    inertia: Vector3
    rotor_speed_max: float
    gravity: float
    torque_factor: float
    def __init__(self, name: _Optional[str] = ..., mass: _Optional[float] = ..., arm_length: _Optional[float] = ..., thrust_coefficient: _Optional[float] = ..., torque_coefficient: _Optional[float] = ..., inertia: _Optional[_Union[Vector3, _Mapping]] = ..., rotor_speed_max: _Optional[float] = ..., gravity: _Optional[float] = ..., torque_factor: _Optional[float] = ...) -> None: ...

class Limits(_message.Message):
    __slots__ = ("velocity_min", "velocity_max", "tilt", "body_rate", "thrust_min", "thrust_max", "torque_max", "position_min", "position_max", "level_speed", "acceleration", "acceleration_up", "acceleration_down", "jerk")
    VELOCITY_MIN_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_MAX_FIELD_NUMBER: _ClassVar[int]
    TILT_FIELD_NUMBER: _ClassVar[int]
    BODY_RATE_FIELD_NUMBER: _ClassVar[int]
    THRUST_MIN_FIELD_NUMBER: _ClassVar[int]
    THRUST_MAX_FIELD_NUMBER: _ClassVar[int]
    TORQUE_MAX_FIELD_NUMBER: _ClassVar[int]
    POSITION_MIN_FIELD_NUMBER: _ClassVar[int]
    POSITION_MAX_FIELD_NUMBER: _ClassVar[int]
    LEVEL_SPEED_FIELD_NUMBER: _ClassVar[int]
    ACCELERATION_FIELD_NUMBER: _ClassVar[int]
    ACCELERATION_UP_FIELD_NUMBER: _ClassVar[int]
    ACCELERATION_DOWN_FIELD_NUMBER: _ClassVar[int]
    JERK_FIELD_NUMBER: _ClassVar[int]
    velocity_min: Vector3
    velocity_max: Vector3
    tilt: float
    body_rate: Vector3
    thrust_min: float
    thrust_max: float
    torque_max: Vector3
    position_min: Vector3
    position_max: Vector3
    level_speed: float
    acceleration: float
    acceleration_up: float
    acceleration_down: float
    jerk: float
    def __init__(self, velocity_min: _Optional[_Union[Vector3, _Mapping]] = ..., velocity_max: _Optional[_Union[Vector3, _Mapping]] = ..., tilt: _Optional[float] = ..., body_rate: _Optional[_Union[Vector3, _Mapping]] = ..., thrust_min: _Optional[float] = ..., thrust_max: _Optional[float] = ..., torque_max: _Optional[_Union[Vector3, _Mapping]] = ..., position_min: _Optional[_Union[Vector3, _Mapping]] = ..., position_max: _Optional[_Union[Vector3, _Mapping]] = ..., level_speed: _Optional[float] = ..., acceleration: _Optional[float] = ..., acceleration_up: _Optional[float] = ..., acceleration_down: _Optional[float] = ..., jerk: _Optional[float] = ...) -> None: ...

class Separation(_message.Message):
    __slots__ = ("distance", "shape", "vertical_stretch")
    class Shape(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        SPHERE: _ClassVar[Separation.Shape]
        ELLIPSOID: _ClassVar[Separation.Shape]
        ANY_AXIS: _ClassVar[Separation.Shape]
        ALL_AXES: _ClassVar[Separation.Shape]
    SPHERE: Separation.Shape
    ELLIPSOID: Separation.Shape
    ANY_AXIS: Separation.Shape
    ALL_AXES: Separation.Shape
    DISTANCE_FIELD_NUMBER: _ClassVar[int]
    SHAPE_FIELD_NUMBER: _ClassVar[int]
    VERTICAL_STRETCH_FIELD_NUMBER: _ClassVar[int]
    distance: float
    shape: Separation.Shape
    vertical_stretch: float
    def __init__(self, distance: _Optional[float] = ..., shape: _Optional[_Union[Separation.Shape, str]] = ..., vertical_stretch: _Optional[float] = ...) -> None: ...

class Formation(_message.Message):
    __slots__ = ("name", "points")
    NAME_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    name: str
    points: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, name: _Optional[str] = ..., points: _Optional[_Iterable[float]] = ...) -> None: ...

class Segment(_message.Message):
    __slots__ = ("index", "name", "kind", "start", "duration", "limits", "from_formation", "to_formation", "drones", "places", "goals", "certificate", "moves")
    class Kind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        LAUNCH: _ClassVar[Segment.Kind]
        TRANSITION: _ClassVar[Segment.Kind]
        APPROACH: _ClassVar[Segment.Kind]
        LAND: _ClassVar[Segment.Kind]
        HOLD: _ClassVar[Segment.Kind]
        MOTION: _ClassVar[Segment.Kind]
    LAUNCH: Segment.Kind
    TRANSITION: Segment.Kind
    APPROACH: Segment.Kind
    LAND: Segment.Kind
    HOLD: Segment.Kind
    MOTION: Segment.Kind
    INDEX_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    START_FIELD_NUMBER: _ClassVar[int]
    DURATION_FIELD_NUMBER: _ClassVar[int]
    LIMITS_FIELD_NUMBER: _ClassVar[int]
    FROM_FORMATION_FIELD_NUMBER: _ClassVar[int]
    TO_FORMATION_FIELD_NUMBER: _ClassVar[int]
    DRONES_FIELD_NUMBER: _ClassVar[int]
    PLACES_FIELD_NUMBER: _ClassVar[int]
    GOALS_FIELD_NUMBER: _ClassVar[int]
    CERTIFICATE_FIELD_NUMBER: _ClassVar[int]
    MOVES_FIELD_NUMBER: _ClassVar[int]
    index: int
    name: str
    kind: Segment.Kind
    start: float
    duration: float
    limits: int
    from_formation: str
    to_formation: str
    drones: _containers.RepeatedScalarFieldContainer[int]
    places: _containers.RepeatedScalarFieldContainer[int]
    goals: _containers.RepeatedScalarFieldContainer[float]
    certificate: Certificate
    moves: _containers.RepeatedCompositeFieldContainer[Move]
    def __init__(self, index: _Optional[int] = ..., name: _Optional[str] = ..., kind: _Optional[_Union[Segment.Kind, str]] = ..., start: _Optional[float] = ..., duration: _Optional[float] = ..., limits: _Optional[int] = ..., from_formation: _Optional[str] = ..., to_formation: _Optional[str] = ..., drones: _Optional[_Iterable[int]] = ..., places: _Optional[_Iterable[int]] = ..., goals: _Optional[_Iterable[float]] = ..., certificate: _Optional[_Union[Certificate, _Mapping]] = ..., moves: _Optional[_Iterable[_Union[Move, _Mapping]]] = ...) -> None: ...

class Move(_message.Message):
    __slots__ = ("name", "group", "to_formation", "start", "duration", "certificate", "kind")
    NAME_FIELD_NUMBER: _ClassVar[int]
    GROUP_FIELD_NUMBER: _ClassVar[int]
    TO_FORMATION_FIELD_NUMBER: _ClassVar[int]
    START_FIELD_NUMBER: _ClassVar[int]
    DURATION_FIELD_NUMBER: _ClassVar[int]
    CERTIFICATE_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    name: str
    group: str
    to_formation: str
    start: float
    duration: float
    certificate: Certificate
    kind: Segment.Kind
    def __init__(self, name: _Optional[str] = ..., group: _Optional[str] = ..., to_formation: _Optional[str] = ..., start: _Optional[float] = ..., duration: _Optional[float] = ..., certificate: _Optional[_Union[Certificate, _Mapping]] = ..., kind: _Optional[_Union[Segment.Kind, str]] = ...) -> None: ...

class Certificate(_message.Message):
    __slots__ = ("single_drone_minimum", "dual_bound", "witness", "closest", "method", "statistics")
    class StatisticsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    SINGLE_DRONE_MINIMUM_FIELD_NUMBER: _ClassVar[int]
    DUAL_BOUND_FIELD_NUMBER: _ClassVar[int]
    WITNESS_FIELD_NUMBER: _ClassVar[int]
    CLOSEST_FIELD_NUMBER: _ClassVar[int]
    METHOD_FIELD_NUMBER: _ClassVar[int]
    STATISTICS_FIELD_NUMBER: _ClassVar[int]
    single_drone_minimum: float
    dual_bound: float
    witness: Witness
    closest: Encounter
    method: str
    statistics: _containers.ScalarMap[str, float]
    def __init__(self, single_drone_minimum: _Optional[float] = ..., dual_bound: _Optional[float] = ..., witness: _Optional[_Union[Witness, _Mapping]] = ..., closest: _Optional[_Union[Encounter, _Mapping]] = ..., method: _Optional[str] = ..., statistics: _Optional[_Mapping[str, float]] = ...) -> None: ...

class Witness(_message.Message):
    __slots__ = ("drone", "time", "beta", "knots", "multipliers")
    DRONE_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    BETA_FIELD_NUMBER: _ClassVar[int]
    KNOTS_FIELD_NUMBER: _ClassVar[int]
    MULTIPLIERS_FIELD_NUMBER: _ClassVar[int]
    drone: int
    time: float
    beta: Vector3
    knots: _containers.RepeatedScalarFieldContainer[float]
    multipliers: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, drone: _Optional[int] = ..., time: _Optional[float] = ..., beta: _Optional[_Union[Vector3, _Mapping]] = ..., knots: _Optional[_Iterable[float]] = ..., multipliers: _Optional[_Iterable[float]] = ...) -> None: ...

class Encounter(_message.Message):
    __slots__ = ("drone_a", "drone_b", "time", "distance")
    DRONE_A_FIELD_NUMBER: _ClassVar[int]
    DRONE_B_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_FIELD_NUMBER: _ClassVar[int]
    drone_a: int
    drone_b: int
    time: float
    distance: float
    def __init__(self, drone_a: _Optional[int] = ..., drone_b: _Optional[int] = ..., time: _Optional[float] = ..., distance: _Optional[float] = ...) -> None: ...

class Trajectory(_message.Message):
    __slots__ = ("segment", "drone", "breaks", "state_degree", "state", "control_degree", "control", "meshes")
    SEGMENT_FIELD_NUMBER: _ClassVar[int]
    DRONE_FIELD_NUMBER: _ClassVar[int]
    BREAKS_FIELD_NUMBER: _ClassVar[int]
    STATE_DEGREE_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    CONTROL_DEGREE_FIELD_NUMBER: _ClassVar[int]
    CONTROL_FIELD_NUMBER: _ClassVar[int]
    MESHES_FIELD_NUMBER: _ClassVar[int]
    segment: int
    drone: int
    breaks: _containers.RepeatedScalarFieldContainer[float]
    state_degree: int
    state: _containers.RepeatedScalarFieldContainer[float]
    control_degree: int
    control: _containers.RepeatedScalarFieldContainer[float]
    meshes: _containers.RepeatedCompositeFieldContainer[Mesh]
    def __init__(self, segment: _Optional[int] = ..., drone: _Optional[int] = ..., breaks: _Optional[_Iterable[float]] = ..., state_degree: _Optional[int] = ..., state: _Optional[_Iterable[float]] = ..., control_degree: _Optional[int] = ..., control: _Optional[_Iterable[float]] = ..., meshes: _Optional[_Iterable[_Union[Mesh, _Mapping]]] = ...) -> None: ...

class Mesh(_message.Message):
    __slots__ = ("breaks", "points", "iterations", "why", "found", "errors")
    BREAKS_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    WHY_FIELD_NUMBER: _ClassVar[int]
    FOUND_FIELD_NUMBER: _ClassVar[int]
    ERRORS_FIELD_NUMBER: _ClassVar[int]
    breaks: _containers.RepeatedScalarFieldContainer[float]
    points: _containers.RepeatedScalarFieldContainer[int]
    iterations: int
    why: str
    found: str
    errors: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, breaks: _Optional[_Iterable[float]] = ..., points: _Optional[_Iterable[int]] = ..., iterations: _Optional[int] = ..., why: _Optional[str] = ..., found: _Optional[str] = ..., errors: _Optional[_Iterable[float]] = ...) -> None: ...

class DroneState(_message.Message):
    __slots__ = ("position", "velocity", "attitude", "body_rate", "thrust", "torque", "led")
    POSITION_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_FIELD_NUMBER: _ClassVar[int]
    ATTITUDE_FIELD_NUMBER: _ClassVar[int]
    BODY_RATE_FIELD_NUMBER: _ClassVar[int]
    THRUST_FIELD_NUMBER: _ClassVar[int]
    TORQUE_FIELD_NUMBER: _ClassVar[int]
    LED_FIELD_NUMBER: _ClassVar[int]
    position: Vector3
    velocity: Vector3
    attitude: Vector3
    body_rate: Vector3
    thrust: float
    torque: Vector3
    led: Colour
    def __init__(self, position: _Optional[_Union[Vector3, _Mapping]] = ..., velocity: _Optional[_Union[Vector3, _Mapping]] = ..., attitude: _Optional[_Union[Vector3, _Mapping]] = ..., body_rate: _Optional[_Union[Vector3, _Mapping]] = ..., thrust: _Optional[float] = ..., torque: _Optional[_Union[Vector3, _Mapping]] = ..., led: _Optional[_Union[Colour, _Mapping]] = ...) -> None: ...

class Colour(_message.Message):
    __slots__ = ("red", "green", "blue")
    RED_FIELD_NUMBER: _ClassVar[int]
    GREEN_FIELD_NUMBER: _ClassVar[int]
    BLUE_FIELD_NUMBER: _ClassVar[int]
    red: float
    green: float
    blue: float
    def __init__(self, red: _Optional[float] = ..., green: _Optional[float] = ..., blue: _Optional[float] = ...) -> None: ...

class AbortTable(_message.Message):
    __slots__ = ("data_sha256", "every", "period", "rows", "legs", "flights")
    DATA_SHA256_FIELD_NUMBER: _ClassVar[int]
    EVERY_FIELD_NUMBER: _ClassVar[int]
    PERIOD_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    LEGS_FIELD_NUMBER: _ClassVar[int]
    FLIGHTS_FIELD_NUMBER: _ClassVar[int]
    data_sha256: str
    every: float
    period: float
    rows: _containers.RepeatedCompositeFieldContainer[AbortRow]
    legs: _containers.RepeatedCompositeFieldContainer[Segment]
    flights: _containers.RepeatedCompositeFieldContainer[Trajectory]
    def __init__(self, data_sha256: _Optional[str] = ..., every: _Optional[float] = ..., period: _Optional[float] = ..., rows: _Optional[_Iterable[_Union[AbortRow, _Mapping]]] = ..., legs: _Optional[_Iterable[_Union[Segment, _Mapping]]] = ..., flights: _Optional[_Iterable[_Union[Trajectory, _Mapping]]] = ...) -> None: ...

class AbortRow(_message.Message):
    __slots__ = ("time", "rest", "changes", "way", "legs", "duration")
    class Way(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        ON_THE_GROUND: _ClassVar[AbortRow.Way]
        DOWN_IN_PLACE: _ClassVar[AbortRow.Way]
        HOME: _ClassVar[AbortRow.Way]
        BACK_ALONG_THE_PLAN: _ClassVar[AbortRow.Way]
    ON_THE_GROUND: AbortRow.Way
    DOWN_IN_PLACE: AbortRow.Way
    HOME: AbortRow.Way
    BACK_ALONG_THE_PLAN: AbortRow.Way
    TIME_FIELD_NUMBER: _ClassVar[int]
    REST_FIELD_NUMBER: _ClassVar[int]
    CHANGES_FIELD_NUMBER: _ClassVar[int]
    WAY_FIELD_NUMBER: _ClassVar[int]
    LEGS_FIELD_NUMBER: _ClassVar[int]
    DURATION_FIELD_NUMBER: _ClassVar[int]
    time: float
    rest: float
    changes: _containers.RepeatedScalarFieldContainer[float]
    way: AbortRow.Way
    legs: _containers.RepeatedScalarFieldContainer[int]
    duration: float
    def __init__(self, time: _Optional[float] = ..., rest: _Optional[float] = ..., changes: _Optional[_Iterable[float]] = ..., way: _Optional[_Union[AbortRow.Way, str]] = ..., legs: _Optional[_Iterable[int]] = ..., duration: _Optional[float] = ...) -> None: ...
