// Reads a recording as the viewers of the Foxglove family do, and tells what it found as JSON.
const [core, support, fzstd] = ["@mcap/core", "@mcap/support", "fzstd"].map((name) => require(name));

function parser(channel, schema) {
  if (channel.messageEncoding === "json") {
    return (bytes) => JSON.parse(Buffer.from(bytes).toString());
  }
  const type = support.protobufFromBinaryDescriptor(schema.data).lookupType(schema.name);
  return (bytes) => type.toObject(type.decode(bytes), { longs: Number });
}

async function main() {
  const data = require("fs").readFileSync(process.argv[2]);
  const readable = {
    size: async () => BigInt(data.length),
    read: async (offset, size) => new Uint8Array(data.buffer, data.byteOffset + Number(offset), Number(size)),
  };
  const decompressHandlers = { zstd: (packed, size) => fzstd.decompress(packed, new Uint8Array(Number(size))) };
  const reader = await core.McapIndexedReader.Initialize({ readable, decompressHandlers });
  const found = { counts: {}, last: {}, attachments: [] };
  const parsers = new Map();
  for await (const message of reader.readMessages()) {
    const channel = reader.channelsById.get(message.channelId);
    if (!parsers.has(channel.id)) {
      parsers.set(channel.id, parser(channel, reader.schemasById.get(channel.schemaId)));
    }
    found.counts[channel.topic] = (found.counts[channel.topic] ?? 0) + 1;
    found.last[channel.topic] = parsers.get(channel.id)(message.data);
  }
  for await (const attachment of reader.readAttachments()) {
    found.attachments.push(attachment.name);
  }
  console.log(JSON.stringify(found));
}

main();
