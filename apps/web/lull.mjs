/* lull for JavaScript: browsers, workers, Node, Deno. One thread; run it in a worker where the page
 * must not wait.
 *
 *     import { Denoiser } from './lull.mjs';
 *     const lull = await Denoiser.load(fetch('lull.wasm'), fetch('kernel5_12.tza'));
 *     const clean = lull.denoise({ width, height, color, albedo, normal });
 */

const CONTENTS = ['hdr', 'ldr', 'srgb', 'lightmap_hdr', 'lightmap_dir']; // lull_content
const FEATURES = { color: 1, albedo: 2, normal: 4 }; // LULL_HAS_*

const bytesOf = async (source) => {
  const from = await source;
  if (typeof Response !== 'undefined' && from instanceof Response) {
    if (!from.ok) throw new Error(`lull: ${from.url}: ${from.status} ${from.statusText}`);
    return new Uint8Array(await from.arrayBuffer());
  }
  return from instanceof Uint8Array ? from : new Uint8Array(from);
};

export class Denoiser {
  #exports;
  #progress = null;

  /** The module lull.wasm and weights (a TZA file): each an ArrayBuffer, a Uint8Array, a Response, or
   * a promise of one. The module may also be a WebAssembly.Module. Throws an Error if the weights
   * are none. */
  static async load(module, weights) {
    const self = new Denoiser();
    const code = await module;
    const compiled = code instanceof WebAssembly.Module
      ? code : await WebAssembly.compile(await bytesOf(code));
    const progress = (fraction) => Number(self.#progress(fraction));
    const instance = await WebAssembly.instantiate(compiled, { lull: { progress } });
    self.#exports = instance.exports;
    const file = await bytesOf(weights);
    const at = self.#allocate(file.length);
    new Uint8Array(self.#exports.memory.buffer, at, file.length).set(file);
    self.#check(self.#exports.load(at, file.length));
    return self;
  }

  /** Bytes of memory that the module has taken; it keeps what its largest frame needed. */
  get memoryBytes() {
    return this.#exports.memory.buffer.byteLength;
  }

  /**
   * Denoises a frame; the result is a new Float32Array of 3 numbers a pixel, rows from the top.
   *
   * width, height   pixels
   * color           radiance (or what `content` says), 3 or 4 numbers a pixel, any array of numbers;
   *                 a fourth one, as in RGBA, is left out
   * albedo, normal  optional: in [0, 1]; in [-1, 1], in any space. Without a color the albedo, or
   *                 the normals, are denoised
   * content         of the main image: 'hdr' (linear radiance, the default of colors), 'ldr' (linear,
   *                 at most 1, the default of others), 'srgb', 'lightmap_hdr', 'lightmap_dir'
   * inputScale      brings radiance to the range the network knows; measured where not given
   * onProgress      is told the fraction done; cancels by returning false, or by an error
   *
   * Throws an Error: arrays of another size, features that the weights do not know, no memory,
   * cancelled (its `cancelled` is true).
   */
  denoise({ width, height, color, albedo, normal, content, inputScale = NaN, onProgress }) {
    const given = Object.entries({ color, albedo, normal }).filter(([, image]) => image);
    if (!given.length) throw new Error('lull: no image');
    const kind = CONTENTS.indexOf(content ?? (color ? 'hdr' : 'ldr'));
    if (kind < 0) throw new Error(`lull: content is one of ${CONTENTS.join(', ')}`);
    if (![width, height].every((n) => Number.isInteger(n) && n > 0 && n <= 65536))
      throw new Error('lull: width and height are whole numbers from 1 to 65536');
    const pixels = width * height;
    for (const [name, image] of given)
      if (image.length !== 3 * pixels && image.length !== 4 * pixels)
        throw new Error(`lull: ${name} has ${image.length} numbers, not 3 or 4 for each pixel`);
    this.#exports.begin(width, height, kind);
    const places = given.map(([name, image]) => {
      const at = this.#allocate(12 * pixels);
      const to = new Float32Array(this.#exports.memory.buffer, at, 3 * pixels);
      if (image.length === to.length) to.set(image);
      else
        for (let i = 0, j = 0; i < to.length; i += 3, j += 4) {
          to[i] = image[j];
          to[i + 1] = image[j + 1];
          to[i + 2] = image[j + 2];
        }
      this.#exports.set_image(FEATURES[name], at);
      return at;
    });
    const thrown = [];
    this.#progress = (fraction) => {
      try {
        return onProgress?.(fraction) !== false;
      } catch (error) { // must not pass the module: its stack would stay in use
        thrown.push(error);
        return false;
      }
    };
    const status = this.#exports.run(inputScale);
    this.#progress = null;
    if (thrown.length) throw thrown[0];
    this.#check(status);
    return new Float32Array(this.#exports.memory.buffer, places[0], 3 * pixels).slice();
  }

  #allocate(bytes) {
    const at = bytes < 2 ** 32 && this.#exports.allocate(bytes) >>> 0;
    if (!at) throw new Error('lull: no memory');
    return at;
  }

  #check(status) {
    if (status === 0) return;
    const text = new Uint8Array(this.#exports.memory.buffer, this.#exports.status_text(status) >>> 0);
    const error = new Error(`lull: ${new TextDecoder().decode(text.slice(0, text.indexOf(0)))}`);
    error.cancelled = status === 1; // LULL_CANCELLED
    throw error;
  }
}
