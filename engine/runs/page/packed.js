// Decoder of the arrays that `page_data.py` packs: multiples of a step, delta-coded along the rows, deflated, in base64.

/**
 * @typedef {{at: number, bytes: 1 | 2 | 4, rows: number, columns: number, step: number}} Listed
 * @typedef {Object<string, Float32Array>} Arrays
 */

/**
 * Decode all arrays of a block, each row by row.
 * @param {Object<string, Listed>} listed
 * @param {string} block
 * @returns {Promise<Arrays>}
 */
async function unpacked(listed, block) {
  const bytes = await inflated(block);
  /** @type {Arrays} */
  const found = {};
  for (const [name, one] of Object.entries(listed)) found[name] = unpackedArray(bytes, one);
  return found;
}

/**
 * Inflate a block in base64.
 * @param {string} block
 * @returns {Promise<Uint8Array>}
 */
async function inflated(block) {
  const letters = atob(block);
  const deflated = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) deflated[i] = letters.charCodeAt(i);
  const stream = new Blob([deflated]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/**
 * Decode one array.
 * @param {Uint8Array} bytes
 * @param {Listed} one
 */
function unpackedArray(bytes, one) {
  const count = one.rows * one.columns;
  const out = new Float32Array(count);
  const before = new Int32Array(one.columns);
  const unused = 32 - 8 * one.bytes;
  for (let i = 0; i < count; i++) {
    let whole = 0;
    for (let k = 0; k < one.bytes; k++) whole |= bytes[one.at + k * count + i] << (8 * k);
    const column = i % one.columns;
    before[column] += (whole << unused) >> unused; // extend the sign
    out[i] = before[column] * one.step;
  }
  return out;
}
