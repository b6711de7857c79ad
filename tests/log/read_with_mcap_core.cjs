// Reads a log with @mcap/core, streamed and indexed, and prints what it found.
const fs = require("node:fs");
const { McapStreamReader, McapIndexedReader } = require("@mcap/core");
const { loadDecompressHandlers } = require("@mcap/support");
const protobuf = require("protobufjs");
const descriptor = require("protobufjs/ext/descriptor");

function decoder(schema) {
  const set = descriptor.FileDescriptorSet.decode(schema.data);
  const root = protobuf.Root.fromDescriptor(set);
  root.resolveAll();
  const type = root.lookupType(schema.name);
  return (data) => type.toObject(type.decode(data), { longs: Number, defaults: true });
}

async function main() {
  const path = process.argv[2];
  const bytes = fs.readFileSync(path);
  const decompressHandlers = await loadDecompressHandlers();
  const stream = new McapStreamReader({ validateCrcs: true, decompressHandlers });
  stream.append(bytes);
  const streamed = {};
  const topics = new Map();
  for (let record; (record = stream.nextRecord()); ) {
    if (record.type === "Channel") topics.set(record.id, record.topic);
    if (record.type === "Message") {
      const topic = topics.get(record.channelId);
      streamed[topic] = (streamed[topic] ?? 0) + 1;
    }
  }
  if (!stream.done()) throw new Error("the stream reader did not reach the end");

  const readable = {
    size: async () => BigInt(bytes.length),
    read: async (offset, length) =>
      new Uint8Array(bytes.buffer, bytes.byteOffset + Number(offset), Number(length)),
  };
  const indexed = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const counts = {};
  const decoders = new Map();
  const last = {};
  let rules, first;
  let previous = 0n;
  for await (const message of indexed.readMessages({ validateCrcs: true })) {
    const channel = indexed.channelsById.get(message.channelId);
    const schema = indexed.schemasById.get(channel.schemaId);
    if (message.logTime < previous) throw new Error("messages go back in time");
    previous = message.logTime;
    counts[channel.topic] = (counts[channel.topic] ?? 0) + 1;
    if (!decoders.has(schema.id)) decoders.set(schema.id, decoder(schema));
    const decoded = decoders.get(schema.id)(message.data);
    if (channel.topic === "/show/rules") rules = decoded;
    if (channel.topic === "/fleet/state") {
      first ??= decoded;
      const view = new DataView(decoded.data.buffer, decoded.data.byteOffset);
      last.x = [];
      for (let at = 0; at < decoded.data.length; at += decoded.point_stride) {
        last.x.push([0, 4, 8].map((k) => view.getFloat32(at + k, true)));
      }
    }
    if (channel.topic === "/drone/0001/state") last.state = decoded;
  }
  const attachments = [];
  for await (const found of indexed.readAttachments({ validateCrcs: true })) {
    attachments.push([found.name, found.data.length]);
  }
  console.log(
    JSON.stringify({
      streamed,
      counts,
      attachments,
      header: indexed.header,
      rules: { name: rules.name, drones: rules.drones, duration: rules.duration },
      fields: first.fields.map((field) => [field.name, field.offset, field.type]),
      positions: last.x,
      state: last.state,
      statistics: Number(indexed.statistics.messageCount),
    }),
  );
}

main().catch((error) => {
  console.error(error.message);
  process.exit(1);
});
