"""The rules that a log must carry, by its script: vehicle, site, limits, formations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from showc.log import showc_pb2 as pb
from showc.verify.decode import FORMAT_VERSION

if TYPE_CHECKING:
    from google.protobuf.message import Message

    from showc.arrays import FloatArray
    from showc.script.show import Show
    from showc.vehicle import Limits

    Built = TypeVar("Built", bound=Message)


def rules_message(
    show: Show, formations: dict[str, FloatArray], limits: list[Limits], duration: float
) -> pb.Rules:
    """Return the rules that a log of the show must carry."""
    fence = [] if show.site.fence is None else np.ravel(show.site.fence).tolist()
    shape = show.separation.shape.upper().replace("-", "_")
    return message_of(
        pb.Rules,
        show,
        format_version=FORMAT_VERSION,
        duration=duration,
        site=message_of(pb.Site, show.site, fence=fence),
        vehicle=message_of(pb.Vehicle, show.vehicle),
        separation=message_of(pb.Separation, show.separation, shape=shape),
        yaw_held=show.yaw == "held",
        formations=[
            pb.Formation(name=name, points=np.ravel(points).tolist())
            for name, points in formations.items()
        ],
        limits=[message_of(pb.Limits, one) for one in limits],
    )


def message_of(kind: type[Built], source: object, **given: Any) -> Built:  # noqa: ANN401
    """Fill a message: its fields have the names of the attributes of the source."""
    values: dict[str, Any] = {}
    for entry in kind.DESCRIPTOR.fields:
        name = entry.name
        value = given[name] if name in given else getattr(source, name)
        if entry.message_type is pb.Vector3.DESCRIPTOR:
            value = dict(zip("xyz", map(float, value), strict=True))
        values[name] = value
    return kind(**values)
