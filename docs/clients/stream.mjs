// Watches a robot: prints each frame of the live stream as a line of JSON, of arrays only the lengths.
// `node stream.mjs [ADDRESS]`, node 22 or newer; without the first and the last line it runs in a browser, too.

const address = process.argv[2] ?? "ws://127.0.0.1:8000/api/v1/stream";
const types = { "<f4": Float32Array, "<i2": Int16Array, "<i4": Int32Array, "<u2": Uint16Array, "|u1": Uint8Array };
const socket = new WebSocket(address);
socket.binaryType = "arraybuffer";
socket.onmessage = ({ data }) => {
  const [sequence, size] = new Uint32Array(data, 0, 2);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 8, size)));
  const arrays = {};
  let offset = 8 + size;
  for (const [name, dtype, shape] of header.arrays) {
    arrays[name] = new types[dtype](data, offset, shape.reduce((product, n) => product * n, 1));
    offset += Math.ceil(arrays[name].byteLength / 8) * 8; // each array starts at a multiple of eight bytes
  }
  socket.send(JSON.stringify({ type: "ack", seq: sequence })); // without it the server waits for ever
  const lengths = Object.entries(arrays).map(([name, array]) => [name, array.length]);
  console.log(JSON.stringify({ ...header, arrays: Object.fromEntries(lengths) }));
};
