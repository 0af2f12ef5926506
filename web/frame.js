// Frames of the stream as the server packs them (docs/http.md): pure functions, no socket and no page.

const ARRAYS = {
  "|u1": Uint8Array, "<u2": Uint16Array, "<u4": Uint32Array, "<i2": Int16Array, "<i4": Int32Array,
  "<f4": Float32Array, "<f8": Float64Array,
};

/** Sequence number, header and arrays of one binary frame; the arrays look into the buffer without a copy. */
export function decodeFrame(buffer) {
  const view = new DataView(buffer);
  const sequence = view.getUint32(0, true);
  const size = view.getUint32(4, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, size)));
  const arrays = {};
  let offset = 8 + size;
  for (const [name, type, shape] of header.arrays) {
    const count = shape.reduce((product, length) => product * length, 1);
    const values = new ARRAYS[type](buffer, offset, count);
    arrays[name] = { values, shape };
    offset += Math.ceil(values.byteLength / 8) * 8;
  }
  return { sequence, topic: header.topic, header, arrays };
}

/** Curves as lists of [x, y] in metres, from points in `scale` units and the curves' lengths. */
export function unpackCurves(points, lengths, scale) {
  const curves = [];
  let index = 0;
  for (const length of lengths.values) {
    const curve = [];
    for (let k = 0; k < length; k++, index++) {
      curve.push([scale * points.values[2 * index], scale * points.values[2 * index + 1]]);
    }
    curves.push(curve);
  }
  return curves;
}

/** Bytes that were deflated in zlib's format, as they were. */
export async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** The rows of an (n, m) array. */
export function rows({ values, shape }) {
  return Array.from({ length: shape[0] }, (_, row) => values.subarray(row * shape[1], (row + 1) * shape[1]));
}
