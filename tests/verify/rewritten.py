"""A log written again by another library, with some messages replaced."""

from __future__ import annotations

from io import BytesIO

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer


def rewritten(data: bytes, replace, schemas_of=lambda _, data: data) -> bytes:
    """Return the same log with each message passed through ``replace``.

    ``replace(topic, number, message)`` gets the topic, how many messages came before
    on it, and the bytes; it returns the new bytes, or None to leave the message out.
    ``schemas_of(name, data)`` may change a schema.
    """
    reader = make_reader(BytesIO(data))
    target = BytesIO()
    writer = Writer(
        target,
        chunk_size=1 << 20,
        compression=CompressionType.ZSTD,
        enable_data_crcs=True,
    )
    header = reader.get_header()
    writer.start(profile=header.profile, library=header.library)
    for attachment in reader.iter_attachments():
        writer.add_attachment(
            attachment.create_time,
            attachment.log_time,
            attachment.name,
            attachment.media_type,
            attachment.data,
        )
    for metadata in reader.iter_metadata():
        writer.add_metadata(metadata.name, metadata.metadata)
    schemas, channels, counts = {}, {}, {}
    for schema, channel, message in reader.iter_messages(log_time_order=False):
        if schema.id not in schemas:
            schemas[schema.id] = writer.register_schema(
                schema.name, schema.encoding, schemas_of(schema.name, schema.data)
            )
        if channel.id not in channels:
            channels[channel.id] = writer.register_channel(
                channel.topic, channel.message_encoding, schemas[schema.id]
            )
            counts[channel.id] = [0, 0]
        new = replace(channel.topic, counts[channel.id][0], message.data)
        counts[channel.id][0] += 1
        if new is None:
            continue
        writer.add_message(
            channels[channel.id],
            message.log_time,
            new,
            message.publish_time,
            counts[channel.id][1],
        )
        counts[channel.id][1] += 1
    writer.finish()
    return target.getvalue()
